"""What libraries do that we change: each with the version in which we found it, and when it can go."""

from collections.abc import Callable
from functools import partial


def bound_rosbags(most_bytes: int) -> None:
    """Make rosbags unpack no more of a chunk than its stated size, and at most `most_bytes`.

    rosbags 0.11.9 unpacks all that a chunk has before it compares sizes. Goes once it stops at the stated size.
    """
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, zstd

    def unpack(begin: Callable, data: bytes, size: int) -> bytes:
        if size > most_bytes:
            raise ValueError(f"a chunk has {size} bytes, more than {most_bytes}")
        return begin().decompress(data, size + 1)

    DECOMPRESSORS.update(lz4=partial(unpack, LZ4FrameDecompressor), zstd=partial(unpack, zstd.ZstdDecompressor))
