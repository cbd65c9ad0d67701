"""Small laboratory files of known photons, for the tests of their readers."""

import struct
from pathlib import Path

import numpy as np

T3, T2 = 0x00010307, 0x00010207         # record types of a MultiHarp
_TAG_INT, _TAG_FLOAT, _TAG_BOOL, _TAG_EMPTY = 0x10000008, 0x20000008, 0x00000008, 0xFFFF0008


def pulse_cube(rows: int = 6, cols: int = 8, bins: int = 120, photons: int = 30) -> np.ndarray:
    """Counts uint16 [rows, cols, bins]: a tilted surface, and some background."""
    rng = np.random.default_rng(3)
    counts = rng.poisson(0.02, (rows, cols, bins)).astype(np.uint16)
    row, col = np.mgrid[:rows, :cols]
    for shift, share in zip(range(-2, 3), (0.1, 0.25, 0.3, 0.25, 0.1)):
        counts[row, col, 40 + row * 2 + col + shift] += rng.poisson(photons * share, (rows, cols)).astype(np.uint16)
    return counts


def _tag(name: str, value: float | int | bool | None, index: int = -1) -> bytes:
    """An entry of PicoQuant's headers."""
    kind = _TAG_EMPTY if value is None else {bool: _TAG_BOOL, float: _TAG_FLOAT, int: _TAG_INT}[type(value)]
    return struct.pack("<32siI" + ("d" if kind == _TAG_FLOAT else "q"), name.encode(), index, kind, value or 0)


def ptu(path: Path, records: list[int], record_type: int, tags: dict | None = None) -> Path:
    """A .ptu file of these records."""
    header = {"MeasDesc_GlobalResolution": 12e-9 if record_type == T3 else 1e-12, "MeasDesc_Resolution": 100e-12,
              "Measurement_Mode": 3 if record_type == T3 else 2, "Measurement_SubMode": 3,
              "TTResultFormat_TTTRRecType": record_type, "TTResultFormat_BitsPerRecord": 32,
              "TTResult_NumberOfRecords": len(records)} | (tags or {}) | {"Header_End": None}
    content = b"PQTTTR\0\0001.0.00\0\0" + b"".join(_tag(name, value) for name, value in header.items())
    path.write_bytes(content + np.array(records, "<u4").tobytes())
    return path
