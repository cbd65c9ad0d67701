"""The container of a MATLAB 5 .mat file, unpacked and checked before scipy reads it.

scipy's reader trusts the file: sizes are allocated as declared, and unknown type codes crash the process. So sizes are
bounded here, and the structure of every variable is walked through; scipy gets the bytes that were looked at.
Format: MATLAB's "MAT-File Format", level 5.
"""

import io
import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

MAX_UNPACKED_BYTES = 2**30
HEADER_BYTES = 128
TAG_BYTES = 8
HDF5 = b"\x89HDF"
EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15                           # type codes of elements
NUMBER_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
TEXT_TYPES = (1, 2, 4, 16, 17, 18)
CELL, CHAR, NUMBERS, COMPLEX = 1, 4, range(6, 16), 0x0800                           # classes and flags of matrices
READ = (CELL, CHAR, *NUMBERS)
MAX_DEPTH = 8


def unpacked(path: Path) -> io.BytesIO:
    """The file with its variables uncompressed.

    Raises:
        InvalidInput: `path` is not a whole MATLAB 5 file that unpacks to at most MAX_UNPACKED_BYTES.
    """
    size, out = path.stat().st_size, io.BytesIO()
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        require(HDF5 not in header and b"MATLAB 7.3" not in header, path.name, "a MATLAB 7.3 (HDF5) file",
                f"{EXPECTED}: load it in MATLAB and save it with -v7")
        require(header[126:128] in (b"IM", b"MI"), path.name, "not a .mat file", EXPECTED)
        order = "<" if header[126:128] == b"IM" else ">"
        out.write(header)
        while tag := file.read(TAG_BYTES):
            kind, length = struct.unpack(order + "II", tag) if len(tag) == TAG_BYTES else (0, size)
            require(file.tell() + length <= size, path.name, "truncated", EXPECTED)
            element = tag + file.read(length)
            try:
                size_unpacked = out.tell() + _unpacked_length(element, order)
                if size_unpacked <= MAX_UNPACKED_BYTES:
                    out.write(_checked(element, order))
            except (zlib.error, struct.error, InvalidInput):
                raise InvalidInput(path.name, "damaged", EXPECTED) from None
            require(size_unpacked <= MAX_UNPACKED_BYTES, f"{path.name} size", f"{size_unpacked} bytes unpacked",
                    f"at most {MAX_UNPACKED_BYTES} bytes")
    out.seek(0)
    return out


def _unpacked_length(element: bytes, order: str) -> int:
    """What an element says of itself: with its tag, uncompressed."""
    if struct.unpack_from(order + "I", element)[0] == COMPRESSED:
        element = zlib.decompressobj().decompress(memoryview(element)[TAG_BYTES:], TAG_BYTES)
    return TAG_BYTES + struct.unpack_from(order + "4xI", element)[0]


def _checked(element: bytes, order: str) -> bytes:
    """The element, uncompressed; nothing of structures and such, which are not read.

    Raises:
        InvalidInput, struct.error, zlib.error: it is no matrix from its beginning to its end.
    """
    if struct.unpack_from(order + "I", element)[0] == COMPRESSED:
        length, inflater = _unpacked_length(element, order), zlib.decompressobj()
        element = inflater.decompress(memoryview(element)[TAG_BYTES:], length + 1)
        require(len(element) == length and inflater.eof, "length", len(element), f"{length}")
    kind = struct.unpack_from(order + "I", element)[0]
    require(kind == MATRIX, "type", kind, "a matrix")
    matrix = memoryview(element)[TAG_BYTES:]
    if _flags(matrix, order) & 0xFF not in READ:
        return b""
    _check_matrix(matrix, order)
    return element


def _flags(matrix: memoryview, order: str) -> int:
    kind, content = next(_elements(matrix, order), (0, b""))
    require(kind == UINT32 and len(content) == 8, "flags", kind, "class and flags of a matrix")
    return struct.unpack_from(order + "I", content)[0]


def _check_matrix(matrix: memoryview, order: str, depth: int = 0) -> None:
    """Raise InvalidInput or struct.error unless it is a matrix as its class and dimensions say."""
    if depth and not len(matrix):
        return                                              # an empty cell
    flags, elements = _flags(matrix, order), _elements(matrix, order)
    matrix_class = flags & 0xFF
    _, dimensions, name = (next(elements, (0, b"")) for _ in range(3))
    require((dimensions[0], name[0]) == (INT32, INT8) and depth < MAX_DEPTH, "header", depth, "a matrix")
    require(matrix_class in READ, "class", matrix_class, "cells, text or numbers")
    lengths = struct.unpack(f"{order}{len(dimensions[1]) // 4}i", dimensions[1])
    require(len(lengths) >= 2 and min(lengths) >= 0, "dimensions", lengths, "0 or more")
    count, parts = math.prod(lengths), 0
    for kind, content in elements:
        parts += 1
        if matrix_class == CELL:
            require(kind == MATRIX, "cell", kind, "a matrix")
            _check_matrix(content, order, depth + 1)
        elif matrix_class == CHAR:
            require(kind in TEXT_TYPES, "text", kind, "characters")
        else:
            fits = kind in NUMBER_BYTES and NUMBER_BYTES[kind] * count == len(content)
            require(fits, "numbers", len(content), "one per place")
    wanted = count if matrix_class == CELL else 2 if flags & COMPLEX else 1
    require(parts == wanted or (matrix_class == CHAR and parts <= 1), "parts", parts, f"{wanted}")


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type code and content of the elements in `data`; struct.error where they do not fit."""
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        start = at + 8
        if kind >> 16:                                      # the small form: at most 4 bytes inside the tag
            kind, length, start = kind & 0xFFFF, kind >> 16, at + 4
            if length > 4:
                raise struct.error
        if start + length > len(data):
            raise struct.error
        yield kind, data[start: start + length]
        at = start + 4 if start == at + 4 else start + -(-length // 8) * 8
