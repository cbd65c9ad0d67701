"""The container of a MATLAB 5 .mat file, checked before scipy unpacks it.

scipy's reader trusts the file: sizes are allocated as declared, and unknown type codes crash the process. So declared
sizes are bounded here, and the structure of variables that no checksum protects (uncompressed ones) is walked through.
Format: MATLAB's "MAT-File Format", level 5.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

MAX_UNPACKED_BYTES = 2**30
HEADER_BYTES = 128
FIRST_BYTES = 4096          # enough compressed data for the first 8 unpacked bytes
HDF5 = b"\x89HDF"
EXPECTED = "a MATLAB 5 .mat file, whole (save -v7)"
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15                           # type codes of elements
NUMBER_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
TEXT_TYPES = (1, 2, 4, 16, 17, 18)
CELL, CHAR, NUMBERS, COMPLEX = 1, 4, range(6, 16), 0x0800                           # classes and flags of matrices
MAX_DEPTH = 8


def check_container(path: Path) -> None:
    """Raise InvalidInput unless `path` is a whole MATLAB 5 file that unpacks to at most MAX_UNPACKED_BYTES."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        require(HDF5 not in header and b"MATLAB 7.3" not in header, path.name, "a MATLAB 7.3 (HDF5) file",
                f"{EXPECTED}: load it in MATLAB and save it with -v7")
        require(header[126:128] in (b"IM", b"MI"), path.name, "not a .mat file", EXPECTED)
        order = "<" if header[126:128] == b"IM" else ">"
        at, unpacked = HEADER_BYTES, 0
        while at < size:
            file.seek(at)
            tag = file.read(8)
            kind, length = struct.unpack(order + "II", tag) if len(tag) == 8 else (0, size)
            at += 8 + length
            require(at <= size, path.name, "truncated", EXPECTED)
            try:
                if kind == COMPRESSED:
                    unpacked += _unpacked_length(file.read(min(length, FIRST_BYTES)), order)
                else:
                    unpacked += length
                    require(kind == MATRIX and unpacked <= MAX_UNPACKED_BYTES, "", kind, "a variable of bounded size")
                    _check_matrix(memoryview(file.read(length)), order)
            except (zlib.error, struct.error, InvalidInput):
                raise InvalidInput(path.name, "damaged", EXPECTED) from None
            require(unpacked <= MAX_UNPACKED_BYTES, f"{path.name} size", f"{unpacked} bytes unpacked",
                    f"at most {MAX_UNPACKED_BYTES} bytes")


def _unpacked_length(start: bytes, order: str) -> int:
    return struct.unpack(order + "II", zlib.decompressobj().decompress(start, 8))[1]


def _check_matrix(data: memoryview, order: str, depth: int = 0) -> None:
    """Raise InvalidInput or struct.error unless `data` is a matrix as its class and dimensions say."""
    if depth and not len(data):
        return                                              # an empty cell
    elements = _elements(data, order)
    flags, dimensions, name = (next(elements, (0, b"")) for _ in range(3))
    types = (flags[0], dimensions[0], name[0])
    require(types == (UINT32, INT32, INT8) and len(flags[1]) == 8 and depth < MAX_DEPTH, "header", types, "a matrix")
    word = struct.unpack(order + "I", flags[1][:4])[0]
    count = 1
    for length in struct.unpack(f"{order}{len(dimensions[1]) // 4}i", dimensions[1]):
        require(length >= 0, "dimension", length, "0 or more")
        count *= length
    matrix_class, parts = word & 0xFF, 0
    if matrix_class != CELL and matrix_class != CHAR and matrix_class not in NUMBERS:
        require(depth == 0, "class", matrix_class, "numbers in cells")
        return                                              # structures and such: not read either
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
    wanted = count if matrix_class == CELL else 2 if word & COMPLEX else 1
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
