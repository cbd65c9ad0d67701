"""Arrays of files that may be damaged or hostile: sizes are bounded before anything is loaded."""

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

# Of all arrays that are read from a file: 12 bytes for each of the most photons, or half of a smaller machine's memory.
MAX_ARRAY_BYTES = min(3 * 2**30, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
MAX_MEMBERS = 1000
MAX_SIDES = 8
# What a reader raises where it trusts a damaged file: their texts speak of its code, not of the file.
OF_THE_READER = (NameError, TypeError, AttributeError, LookupError, AssertionError, ArithmeticError)
ZIP_MARK = b"PK\x03\x04"      # begins each member of a zip file
FORMATS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def require_file(path: Path, field: str) -> None:
    """Raise InvalidInput unless `path` is a file that can be opened."""
    # A name too long is not absent, nor is what lies in a folder that may not be entered.
    with file_errors(field, path, "read"):
        require(path.is_file(), field, str(path), "a file that exists")
        path.open("rb").close()


@contextmanager
def read_errors(path: Path, expected: str = "", library: str = "") -> Iterator[None]:
    """Put the name of the file before the field of any InvalidInput.

    Args:
        expected: what the file should be, in words: then whatever else a reader of others raises on a damaged file
            becomes one InvalidInput.
        library: the name of that reader's logger, which is kept silent.
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
    except Exception as error:      # each library has its own, and Python's where it trusts the file
        if not expected:
            raise
        why = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        if isinstance(error, OF_THE_READER):
            why = "its reader failed"
        raise InvalidInput(path.name, f"unreadable ({why})", expected) from None
    finally:
        log.setLevel(level)


def read_npz_arrays(path: Path, names: tuple[str, ...], field: str = "photon file", and_cubes: bool = False
                    ) -> dict[str, np.ndarray]:
    """Those of the arrays `names` that an .npz file has; no pickles, sizes checked against the headers.

    Args:
        field: what the file is, to say that it is absent.
        and_cubes: also the arrays of three dimensions, whatever they are called.

    Raises:
        InvalidInput: not a zip file, truncated, an array of objects, or arrays of more than MAX_ARRAY_BYTES together.
    """
    require_file(path, field)
    with path.open("rb") as file, read_errors(path):
        begins_as_zip = file.read(len(ZIP_MARK)) == ZIP_MARK
        try:
            with zipfile.ZipFile(file) as archive:
                return _arrays(archive, names, and_cubes)
        except InvalidInput:
            raise
        except Exception as error:      # zipfile, zlib and NumPy have a dozen kinds for what is damaged
            why = f"unreadable ({error})"
            if begins_as_zip:           # whose directory is at its end: without it, zipfile takes the file for no zip
                why = "truncated or damaged" + ("" if isinstance(error, zipfile.BadZipFile) else f" ({error})")
            raise InvalidInput("", why, "a complete .npz file (a zip of arrays)") from None


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


def map_npy(path: Path, field: str, most: int = MAX_ARRAY_BYTES) -> np.ndarray:
    """The array of an .npy file, mapped into memory; InvalidInput if it is none, or of more than `most` bytes."""
    with path.open("rb") as stream:
        shape, _ = npy_header(stream, path.stat().st_size, field, most)
    require(math.prod(shape) > 0, field, "empty", "an array with something in it")
    return np.load(path, mmap_mode="c", allow_pickle=False)


def npy_header(stream: BinaryIO, file_size: int, field: str, most: int = MAX_ARRAY_BYTES) -> tuple[tuple, np.dtype]:
    """Shape and type of the array after a header with which the file's size agrees.

    Raises:
        InvalidInput: there is none, or one of Python objects or of more than `most` bytes.
    """
    try:
        shape, _, dtype = FORMATS[np.lib.format.read_magic(stream)](stream)
    except Exception as error:      # a header is a Python literal, which can be wrong in many ways
        raise InvalidInput(field, f"unreadable ({error})", "an array as NumPy writes it") from None
    require(dtype.kind in "biufcSU", f"{field} dtype", str(dtype), "numbers or text, not Python objects")
    fits = len(shape) <= MAX_SIDES and all(0 <= side < 2**63 for side in shape)
    require(fits, f"{field} shape", shape, f"at most {MAX_SIDES} sizes from 0 to 2⁶³")
    size, stored = math.prod(shape) * dtype.itemsize, file_size - stream.tell()
    require(size <= most, f"{field} size", f"{size} bytes", f"at most {most} bytes")
    require(size == stored, f"{field} size", f"{stored} bytes", f"{size} bytes, as its header says")
    return shape, dtype
