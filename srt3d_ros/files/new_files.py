"""Files that take their place only when they are whole, and names for those that must not take another's place."""

import os
import secrets
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A new file beside `path`, with its suffix, to write to: it becomes `path` if the block ends well, else it goes.

    Nobody can have put a link there for us to write through: its name cannot be guessed, and nothing may have it.
    """
    part = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.part{path.suffix}")
    part.open("x").close()
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def file_errors(field: str, path: str | Path, use: str = "written") -> Iterator[None]:
    """Raise InvalidInput, naming field and path, for an OSError within the block, which uses the file so."""
    try:
        yield
    except OSError as error:
        raise InvalidInput(field, str(path), f"a file that can be {use} ({error.strerror or error})") from None


def check_place(path: Path) -> None:
    """Raise InvalidInput unless a file could be written to `path`, as far as can be known before it is."""
    folder = path.parent
    require(not os.path.isdir(path), "output", str(path), "a file, not a directory")
    require(os.path.isdir(folder), "output", str(path), f"a directory {folder} that exists")
    require(os.access(folder, os.W_OK), "output", str(path), f"a directory {folder} that can be written to")


def check_not_input(output: str | Path, *inputs: str | Path | None) -> None:
    """Raise InvalidInput if `output` is one of the files or folders that are read, whatever its path is spelled as."""
    for path in inputs:
        same = path is not None and os.path.exists(output) and os.path.exists(path) and os.path.samefile(output, path)
        require(not same, "output", str(output), "another file than the input")


def check_replaceable(path: Path, array: str) -> None:
    """Raise InvalidInput if `path` is an .npz file without this array: photons, say, where a cloud shall be written."""
    if path.suffix.lower() == ".npz" and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        require(f"{array}.npy" in names, "output", str(path), "another name: that file holds something else")


def free(path: Path) -> Path:
    """`path`, or the first of NAME_2, NAME_3, … with its suffix, where nothing is, not even a broken link."""
    names = chain([path], (path.with_stem(f"{path.stem}_{k}") for k in count(2)))
    return next(name for name in names if not os.path.lexists(name))
