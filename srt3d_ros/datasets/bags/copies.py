"""Temporary copies of files of a bag that rosbags cannot read in place: packed ones, and databases left open."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from srt3d_ros.errors import require

PACKED = ".zstd"
JOURNALS = ("-wal", "-journal")     # behind a database's name: where SQLite keeps what it had not yet moved into it
BLOCK_BYTES = 2**20


def journals_of(file: Path) -> list[Path]:
    """The journals beside a database that was not closed."""
    beside = (file.with_name(file.name + suffix) for suffix in JOURNALS)
    return [path for path in beside if path.is_file() and path.stat().st_size]


@contextmanager
def readable(file: Path) -> Iterator[Path]:
    """The file; or a copy of it until the end of the context, unpacked, or with its journals applied.

    Raises:
        InvalidInput: the copy would take more than half of the free space.
    """
    journals = journals_of(file)
    if file.suffix != PACKED and not journals:
        yield file
        return
    with TemporaryDirectory(prefix="srt3d_bag_") as folder:
        copy = Path(folder, file.name.removesuffix(PACKED))
        for source in (file, *journals):
            with _opened(source) as content:
                _copy(content, copy if source == file else copy.with_name(source.name), source)
        if journals:
            with closing(sqlite3.connect(copy)) as database:
                database.execute("PRAGMA journal_mode = DELETE")        # moves the journal into the database
                database.execute("SELECT count(*) FROM sqlite_master").fetchone()
        yield copy


def _opened(file: Path) -> BinaryIO:
    """The unpacked content of a file."""
    if file.suffix != PACKED:
        return file.open("rb")
    from rosbags.rosbag2.storage_mcap import zstd

    return zstd.open(file, "rb")


def _copy(content: BinaryIO, copy: Path, source: Path) -> None:
    left = shutil.disk_usage(copy.parent).free // 2
    with copy.open("wb") as file:
        while block := content.read(BLOCK_BYTES):
            left -= len(block)
            require(left >= 0, "bag", problem=f"bag {source.name}: its temporary copy takes more than half of the free "
                    f"space in {copy.parent.parent}. Set TMPDIR to a larger folder.")
            file.write(block)
