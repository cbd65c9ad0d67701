"""Read arrays from files that may be damaged or hostile: sizes are checked before anything is loaded."""

import io
import math
import os
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files.isolated_child import listing, may_be_counts
from srt3d_ros.files.new_files import file_errors

# All arrays of a file together: 12 bytes for each of MAX_EVENTS photons, or half of a smaller machine's memory.
MAX_ARRAY_BYTES = min(3 * 2**30, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
MAX_MEMBERS = 1000
MAX_SIDES = 8
MAX_HEADER_BYTES = 2**14        # of an array; NumPy refuses more than 10,000 characters
# Errors of a reader that trusts a damaged file: their texts describe its code, not the file.
READER_ERRORS = (NameError, TypeError, AttributeError, LookupError, AssertionError, ArithmeticError)
FORMATS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def require_file(path: Path, field: str) -> None:
    """Raise InvalidInput unless `path` is a file that can be opened."""
    with file_errors(field, path, "read"):      # the name may be too long, or the folder closed
        require(path.is_file(), field, problem=f"{path}: no such file.")
        path.open("rb").close()


@contextmanager
def read_errors(path: Path, expected: str = "") -> Iterator[None]:
    """Put the file's name in front of any InvalidInput.

    Args:
        expected: what the file should be, in words. If given, all other errors become InvalidInput, too.
    """
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


def read_npz_arrays(path: Path, names: Collection[str], field: str = "photon file"
                    ) -> tuple[dict[str, np.ndarray], str]:
    """The arrays `names` of an .npz file (called `field` in errors), the only one that may be counts; a list of all.

    InvalidInput if it is no zip file, damaged, or has objects or more than MAX_ARRAY_BYTES in these arrays.
    """
    require_file(path, field)
    with read_errors(path, "a complete .npz file (a zip of arrays)"), zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()
                   if info.filename.endswith(".npy")}
        require(len(members) <= MAX_MEMBERS, "members", len(members), f"at most {MAX_MEMBERS}")
        listed, sizes = [], {}
        for name, info in members.items():
            try:
                with archive.open(info) as stream:
                    shape, dtype = npy_header(stream, info.file_size, name)
            except InvalidInput:
                if name in names:
                    raise
                listed.append((name, (), "unreadable"))
                continue
            listed.append((name, shape, str(dtype)))
            sizes[name] = math.prod(shape) * dtype.itemsize
        cubes = [name for name, shape, kind in listed if name in sizes and may_be_counts(shape, kind)]
        chosen = [name for name in sizes if name in names or cubes == [name]]
        size = sum(sizes[name] for name in chosen)
        require(size <= MAX_ARRAY_BYTES, "size", f"{size} bytes", f"at most {MAX_ARRAY_BYTES}; an .npy may have more")
        arrays = {}
        for name in chosen:
            with archive.open(members[name]) as stream:
                arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return arrays, listing(listed)


def map_npy(path: Path, field: str, most: int = MAX_ARRAY_BYTES) -> np.ndarray:
    """The array of an .npy file, mapped into memory; InvalidInput if it has no array or more than `most` bytes."""
    with path.open("rb") as stream:
        shape, _ = npy_header(stream, path.stat().st_size, field, most)
    require(math.prod(shape) > 0, field, problem=f"{path.name} has an empty array.")
    return np.load(path, mmap_mode="c", allow_pickle=False)


def npy_header(stream: IO[bytes], file_size: int, field: str, most: int = MAX_ARRAY_BYTES) -> tuple[tuple, np.dtype]:
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
