"""Small laboratory files of known photons, for the tests of their readers."""

import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from srt3d_ros.photons import Photons
from tests.photon_forms import as_histograms

T3, T2 = 0x00010307, 0x00010207         # record types of a MultiHarp
PICOHARP_T2 = 0x00010203
_TAG_INT, _TAG_FLOAT, _TAG_BOOL, _TAG_EMPTY = 0x10000008, 0x20000008, 0x00000008, 0xFFFF0008


def pulse_cube(rows: int = 6, cols: int = 8, bins: int = 120, photons: int = 30) -> np.ndarray:
    """Counts uint16 [rows, cols, bins]: a tilted surface, and some background."""
    rng = np.random.default_rng(3)
    counts = rng.poisson(0.02, (rows, cols, bins)).astype(np.uint16)
    row, col = np.mgrid[:rows, :cols]
    for shift, share in zip(range(-2, 3), (0.1, 0.25, 0.3, 0.25, 0.1)):
        counts[row, col, 40 + row * 2 + col + shift] += rng.poisson(photons * share, (rows, cols)).astype(np.uint16)
    return counts


def counts_of(photons: Photons) -> np.ndarray:
    """The photons of events as counts [rows, cols, bins]."""
    return as_histograms(photons.frame, photons.sensor).counts


def write(path: Path, arrays: dict) -> Path:
    """A file of arrays of the kind that the suffix says: .npy (of the first), .npz, .mat or HDF5."""
    if path.suffix == ".npy":
        np.save(path, next(iter(arrays.values())))
    elif path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        savemat(path, arrays)
    else:
        with pytest.importorskip("h5py").File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
    return path


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


def t3(tick: int, toa: int, channel: int = 0) -> int:
    """A photon's record of a MultiHarp in T3 mode."""
    return channel << 25 | int(toa) << 10 | tick


def phu(path: Path, curves: list[np.ndarray], bin_width_s: float, laser_hz: int = 0) -> Path:
    """A .phu file of these curves."""
    header = {"HistoResult_NumberOfCurves": len(curves), "Measurement_Mode": 0, "Measurement_SubMode": 1,
              "MeasDesc_Resolution": bin_width_s}
    tags = [_tag(name, value) for name, value in header.items()]
    offset = 16 + (len(tags) + 3 * len(curves) + 1) * len(tags[0])
    for index, counts in enumerate(curves):
        tags += [_tag("HistResDscr_DataOffset", offset, index), _tag("HistResDscr_HistogramBins", len(counts), index),
                 _tag("HistResDscr_SyncRate", laser_hz, index)]
        offset += 4 * len(counts)
    content = b"PQHISTO\0" + b"1.0.00\0\0" + b"".join([*tags, _tag("Header_End", None)])
    path.write_bytes(content + b"".join(np.asarray(counts).astype("<u4").tobytes() for counts in curves))
    return path


def sdt(path: Path, blocks: list[np.ndarray], tac_range_s: float, laser_hz: float = 0.0) -> Path:
    """An .sdt file of these images uint16 [rows, cols, bins], one data block each; the laser's rate is StopInfo's."""
    from sdtfile import sdtfile

    header = np.zeros(1, np.dtype(sdtfile.FILE_HEADER).newbyteorder("<"))
    measure = np.zeros(1, sdtfile.record_dtype(sdtfile.MEASURE_INFO, 4096).newbyteorder("<"))
    rows, cols, bins = blocks[0].shape
    measure["scan_x"], measure["scan_y"], measure["adc_re"] = cols, rows, bins
    measure["tac_r"], measure["tac_g"] = tac_range_s, 1
    measure["StopInfo"]["max_sync_rate"] = laser_hz
    info = b"*IDENTIFICATION\r\nID : SPC Setup & Data File\r\n*END\r\n"
    block_type = np.dtype(sdtfile.BLOCK_HEADER).newbyteorder("<")
    header["revision"], header["header_valid"], header["chksum"] = 0x28F, 0x5555, 0x55AA
    header["info_offs"], header["info_length"] = header.nbytes, len(info)
    header["meas_desc_block_offs"] = header.nbytes + len(info)
    header["no_of_meas_desc_blocks"], header["meas_desc_block_length"] = 1, measure.nbytes
    offset = header.nbytes + len(info) + measure.nbytes
    header["data_block_offs"], header["no_of_data_blocks"] = offset, len(blocks)
    content = b""
    for counts in blocks:
        block = np.zeros(1, block_type)
        block["data_offs"] = offset + block.nbytes
        offset += block.nbytes + counts.nbytes
        block["next_block_offs"], block["block_type"], block["block_length"] = offset, 0x11, counts.nbytes
        content += block.tobytes() + counts.astype("<u2").tobytes()
    path.write_bytes(header.tobytes() + info + measure.tobytes() + content)
    return path


def matlab_7_3(path: Path, **variables: np.ndarray) -> Path:
    """A .mat file of arrays as `save -v7.3` writes it."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            array = np.atleast_2d(values)
            stored = file.create_dataset(name, data=array.T, chunks=True, compression="gzip")
            stored.attrs["MATLAB_class"] = np.bytes_("double" if array.dtype == np.float64 else str(array.dtype))
    content = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:])
    return path
