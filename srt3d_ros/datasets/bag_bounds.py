"""What bags may make of themselves, within bounds: rosbags unpacks as much as comes, and runs what a database holds."""

import sqlite3
from contextlib import closing
from pathlib import Path

from lz4.frame import LZ4FrameDecompressor
from rosbags.rosbag2 import storage_mcap

from srt3d_ros.errors import require

zstd = storage_mcap.zstd            # of the standard library from Python 3.14 on
MAX_BYTES = 2**30                   # of a message, and of the chunk of messages that is unpacked at once
MAX_RATIO = 100                     # of a file larger than that: bags of photons come to 5
READ_BYTES = 2**20
SQLITE = b"SQLite format 3\0"


def bound_chunks() -> None:
    """Have rosbags unpack no more of a chunk than its header says, nor more than MAX_BYTES."""
    storage_mcap.DECOMPRESSORS |= {"lz4": lambda raw, size: _unpacked(LZ4FrameDecompressor(), raw, size),
                                   "zstd": lambda raw, size: _unpacked(zstd.ZstdDecompressor(), raw, size)}


def message(raw: bytes) -> bytes:
    """A message that was compressed by itself; ValueError or ZstdError if it cannot be unpacked."""
    return _unpacked(zstd.ZstdDecompressor(), raw, MAX_BYTES)


def check(bag: Path) -> None:
    """Look at the files of a bag, or at its only one, before rosbags opens them.

    Raises:
        InvalidInput: a compressed one, of which rosbags makes a temporary one, unpacks to far too much.
        ValueError, sqlite3.Error: a database computes its rows, which may be endless, or is none.
    """
    for path in filter(Path.is_file, bag.iterdir() if bag.is_dir() else [bag]):
        with path.open("rb") as file:
            begin = file.read(len(SQLITE))
        _check_database(path) if begin == SQLITE else _check_unpacked(path)


def _check_unpacked(path: Path) -> None:
    most, found = max(MAX_BYTES, MAX_RATIO * path.stat().st_size), 0
    try:
        with zstd.open(path, "rb") as file:
            while found <= most and (part := file.read(READ_BYTES)):
                found += len(part)
    except (zstd.ZstdError, EOFError):      # not compressed, or damaged, which rosbags tells
        return
    require(found <= most, f"{path.name} size", f"more than {most} bytes unpacked", f"at most {most}")


def _check_database(path: Path) -> None:
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        views = database.execute("SELECT name FROM sqlite_master WHERE rootpage = 0").fetchone()
        columns = database.execute("SELECT m.name FROM sqlite_master AS m, pragma_table_xinfo(m.name) AS c "
                                   "WHERE m.type = 'table' AND c.hidden > 0").fetchone()
    if views or columns:
        raise ValueError(f"{(views or columns)[0]} is computed, not stored")


def _unpacked(decompressor, raw: bytes, size: int) -> bytes:
    if size > MAX_BYTES:
        raise ValueError(f"{size} bytes unpacked, more than {MAX_BYTES}")
    out = decompressor.decompress(raw, max_length=size)
    if not decompressor.eof:
        raise ValueError(f"cut off, or more than {size} bytes unpacked")
    return out
