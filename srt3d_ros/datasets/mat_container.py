"""The container of a MATLAB 5 .mat file, checked before anything is unpacked from it."""

import struct
import zlib
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

MAX_UNPACKED_BYTES = 2**30
HEADER_BYTES = 128
COMPRESSED, MATRIX = 15, 14
HDF5 = b"\x89HDF"
FIRST_BYTES = 4096          # enough compressed data for the first 8 unpacked bytes


def check_container(path: Path) -> None:
    """Raise InvalidInput unless `path` is a whole MATLAB 5 file that unpacks to at most MAX_UNPACKED_BYTES."""
    whole = "a MATLAB 5 .mat file (save -v7)"
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
        require(HDF5 not in header and b"MATLAB 7.3" not in header, path.name, "a MATLAB 7.3 (HDF5) file",
                f"{whole}: load it in MATLAB and save it with -v7")
        require(len(header) == HEADER_BYTES and header[126:128] in (b"IM", b"MI"), path.name, "not a .mat file", whole)
        order = "<" if header[126:128] == b"IM" else ">"
        at, unpacked = HEADER_BYTES, 0
        while at < size:
            file.seek(at)
            tag = file.read(8)
            kind, length = struct.unpack(order + "II", tag) if len(tag) == 8 else (0, size)
            at += 8 + length
            require(at <= size, path.name, "truncated", f"{whole}, complete")
            require(kind in (COMPRESSED, MATRIX), path.name, "damaged", whole)
            if kind == COMPRESSED:
                length = _unpacked_length(file.read(min(length, FIRST_BYTES)), order, path)
            unpacked += length
    require(unpacked <= MAX_UNPACKED_BYTES, f"{path.name} size", f"{unpacked} bytes unpacked",
            f"at most {MAX_UNPACKED_BYTES} bytes")


def _unpacked_length(start: bytes, order: str, path: Path) -> int:
    try:
        return struct.unpack(order + "II", zlib.decompressobj().decompress(start, 8))[1]
    except (zlib.error, struct.error):
        raise InvalidInput(path.name, "damaged", "a MATLAB 5 .mat file (save -v7)") from None
