"""Write files atomically, check output paths, and choose names that replace nothing."""

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
    """Give a new file beside `path` to write to, which replaces `path` if the block succeeds and is removed if not.

    Its random name must be unused, so that no link placed there can redirect the file.
    """
    part = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.part{path.suffix}")
    part.open("x").close()
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def file_errors(field: str, path: str | Path, action: str = "write") -> Iterator[None]:
    """Turn an OSError into InvalidInput: "Cannot write PATH (No space left on device)."."""
    try:
        yield
    except OSError as error:
        raise InvalidInput(field, problem=f"Cannot {action} {path} ({error.strerror or error}).") from None


def check_not_input(output: str | Path, *inputs: str | Path | None) -> None:
    """Raise InvalidInput if `output` is one of the files or folders to read, also by another spelling."""
    for path in inputs:
        same = path is not None and os.path.exists(output) and os.path.exists(path) and os.path.samefile(output, path)
        require(not same, "output", problem=f"Cannot write {output}: it is the input.")


def check_output(path: str | Path, *arrays: str, suffix: str = "") -> Path:
    """The path; InvalidInput unless a file can be written there, with this suffix if one is given.

    An .npz file there must have one of `arrays`: a cloud does not replace photons, say.
    """
    require(isinstance(path, str | Path), "output", type(path).__name__, "a path")
    path = Path(path)
    require(suffix in ("", path.suffix.lower()), "output", path.name, f"a name that ends in {suffix}")
    folder = path.parent
    require(not os.path.isdir(path), "output", problem=f"Cannot write {path}: it is a directory.")
    require(os.path.isdir(folder), "output", problem=f"Cannot write {path}: there is no directory {folder}.")
    require(os.access(folder, os.W_OK), "output", problem=f"Cannot write {path}: no permission in {folder}.")
    if path.suffix.lower() == ".npz" and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        fits = any(f"{array}.npy" in names for array in arrays)
        require(fits, "output", problem=f"Cannot write {path}: that file holds something else.")
    return path


def free(path: Path) -> Path:
    """The first path of NAME, NAME_2, NAME_3, … that does not exist, not even as a broken link."""
    names = chain([path], (path.with_stem(f"{path.stem}_{k}") for k in count(2)))
    return next(name for name in names if not os.path.lexists(name))
