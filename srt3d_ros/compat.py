"""What libraries do that we change: each with the version in which we found it, and when it can go."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun
    from rerun.blueprint import Blueprint


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


def create_rerun_file(path: Path) -> None:
    """Create a stream's file, or raise OSError; the stream's header overwrites the byte.

    rerun 0.41 waits for ever if it cannot. Goes once `RecordingStream.save` raises.
    """
    with path.open("xb") as file:
        file.write(b"R")


def send_rerun_blueprint(stream: "rerun.RecordingStream", blueprint: "Blueprint") -> None:
    """Send a blueprint as rerun.send_blueprint does, and release the stream that it was logged to.

    rerun 0.41 keeps streams and their threads until the process ends, so that a recorder would grow with each
    recording. Goes once https://github.com/rerun-io/rerun/issues/2116 is solved.
    """
    from rerun import RecordingStream, bindings

    made = RecordingStream._from_native(bindings.new_blueprint(
        stream.get_application_id(), make_default=False, make_thread_default=False))
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()       # breaks the reference cycle of the stream and its memory


def free_rerun_streams() -> None:
    """Free streams that have ended and have no references. Goes with the same issue."""
    from rerun import bindings

    bindings.flush_and_cleanup_orphaned_recordings()
