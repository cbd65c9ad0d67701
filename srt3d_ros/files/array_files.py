"""Read arrays from files that may be damaged or hostile: sizes are checked before anything is loaded."""

import io
import logging
import math
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files.new_files import file_errors

# All arrays of a file together: 12 bytes for each of MAX_EVENTS photons, or half of a smaller machine's memory.
MAX_ARRAY_BYTES = min(3 * 2**30, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
MAX_MEMBERS = 1000
MAX_SIDES = 8
MAX_HEADER_BYTES = 2**14        # of an array; NumPy refuses more than 10,000 characters
# Errors of a reader that trusts a damaged file: their texts describe its code, not the file.
READER_ERRORS = (NameError, TypeError, AttributeError, LookupError, AssertionError, ArithmeticError)
ZIP_MARK = b"PK\x03\x04"      # begins each member of a zip file
FORMATS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def require_file(path: Path, field: str) -> None:
    """Raise InvalidInput unless `path` is a file that can be opened."""
    with file_errors(field, path, "read"):      # the name may be too long, or the folder closed
        require(path.is_file(), field, problem=f"{path}: no such file.")
        path.open("rb").close()


@contextmanager
def read_errors(path: Path, expected: str = "", library: str = "") -> Iterator[None]:
    """Put the file's name in front of any InvalidInput.

    Args:
        expected: what the file should be, in words. If given, all other errors become InvalidInput, too.
        library: name of the reader's logger, which is kept silent.
    """
    log = logging.getLogger(library or __name__)
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    except InvalidInput as error:
        if error.field.startswith(path.name):
            raise
        raise error.within(path.name) from None
    except ModuleNotFoundError:
        raise
    except Exception as error:      # libraries raise their own errors, or Python's on damaged files
        if not expected:
            raise
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        if isinstance(error, READER_ERRORS):
            reason = "its reader failed"
        raise InvalidInput(path.name, f"unreadable ({reason})", expected) from None
    finally:
        log.setLevel(level)


def read_npz_arrays(path: Path, names: tuple[str, ...], field: str = "photon file", and_cubes: bool = False
                    ) -> dict[str, np.ndarray]:
    """The arrays `names` of an .npz file (called `field` in errors), with `and_cubes` also all of three dimensions.

    InvalidInput if it is no zip file, damaged, or has objects or more than MAX_ARRAY_BYTES in these arrays.
    """
    require_file(path, field)
    with path.open("rb") as file, read_errors(path):
        begins_as_zip = file.read(len(ZIP_MARK)) == ZIP_MARK
        try:
            with zipfile.ZipFile(file) as archive:
                return _arrays(archive, names, and_cubes)
        except InvalidInput:
            raise
        except Exception as error:      # zipfile, zlib and NumPy raise a dozen kinds
            problem = f"unreadable ({error})"
            if begins_as_zip:           # zipfile reports a cut-off file as no zip file: the directory is at its end
                problem = "damaged" if isinstance(error, zipfile.BadZipFile) else f"damaged ({error})"
            raise InvalidInput("", problem, "a complete .npz file (a zip of arrays)") from None


def _arrays(archive: zipfile.ZipFile, names: tuple[str, ...], and_cubes: bool) -> dict[str, np.ndarray]:
    members = {info.filename[:-4]: info for info in archive.infolist() if info.filename.endswith(".npy")}
    require(len(members) <= MAX_MEMBERS, "members", len(members), f"at most {MAX_MEMBERS}")
    chosen, size = [], 0
    for name, info in members.items():
        if name in names or and_cubes:
            with archive.open(info) as stream:
                shape, dtype = npy_header(stream, info.file_size, name)
            if name in names or len(shape) == 3:
                chosen.append(name)
                size += math.prod(shape) * dtype.itemsize
    require(size <= MAX_ARRAY_BYTES, "size", f"{size} bytes", f"at most {MAX_ARRAY_BYTES}; an .npy may have more")
    arrays = {}
    for name in chosen:
        with archive.open(members[name]) as stream:
            arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return arrays


def npz_contents(path: Path) -> list[tuple[str, tuple[int, ...], str]]:
    """Name, shape and type of each array of an .npz file that can be opened, for an error."""
    contents = []
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist()[:MAX_MEMBERS]:
            name = info.filename.removesuffix(".npy")
            try:
                with archive.open(info) as stream:
                    shape, dtype = npy_header(stream, info.file_size, name)
                contents.append((name, shape, str(dtype)))
            except Exception:       # as read_npz_arrays says, once the array is asked for
                contents.append((name, (), "unreadable"))
    return contents


def map_npy(path: Path, field: str, most: int = MAX_ARRAY_BYTES) -> np.ndarray:
    """The array of an .npy file, mapped into memory; InvalidInput if it has no array or more than `most` bytes."""
    with path.open("rb") as stream:
        shape, _ = npy_header(stream, path.stat().st_size, field, most)
    require(math.prod(shape) > 0, field, problem=f"{path.name} has an empty array.")
    return np.load(path, mmap_mode="c", allow_pickle=False)


def npy_header(stream: BinaryIO, file_size: int, field: str, most: int = MAX_ARRAY_BYTES) -> tuple[tuple, np.dtype]:
    """Shape and type in an .npy header; InvalidInput for objects, more than `most` bytes, or another file size."""
    try:
        head = io.BytesIO(stream.read(MAX_HEADER_BYTES))
        shape, _, dtype = FORMATS[np.lib.format.read_magic(head)](head)
    except Exception as error:      # the header is a Python literal: many errors are possible
        raise InvalidInput(field, f"unreadable ({error})", "an array as NumPy writes it") from None
    require(dtype.kind in "biufcSU", f"{field} dtype", str(dtype), "numbers or text, not Python objects")
    fits = len(shape) <= MAX_SIDES and all(0 <= side < 2**63 for side in shape)
    require(fits, f"{field} shape", shape, f"at most {MAX_SIDES} sizes from 0 to 2⁶³")
    size, stored = math.prod(shape) * dtype.itemsize, file_size - head.tell()
    require(size <= most, f"{field} size", f"{size} bytes", f"at most {most} bytes")
    require(size == stored, f"{field} size", f"{stored} bytes", f"{size} bytes, as its header says")
    return shape, dtype
