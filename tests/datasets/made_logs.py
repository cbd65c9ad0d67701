"""Logs and messages of ams sensors, made here: pulses at known ranges, in the layouts of the vendor's sources."""

import json
import struct
from pathlib import Path

import numpy as np

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.datasets.reading import Reading

BIN_M = 299_792_458.0 / 2 * 0.8e-9      # of a TMF8829
REFERENCE_AT = 3.2                      # where its reference pulse lies, bins
AMBIENT = 100
HALVES_16 = (range(8), range(8, 16))    # columns of T0, T1 in TMF8829_zeromq_protocol.md, as in the next two
COLUMNS_32 = tuple(range(first + half, first + half + 16, 2) for first in (0, 1) for half in (0, 16))
COLUMNS_48 = tuple(range(first + half, first + half + 24, 3) for first in (0, 1, 2) for half in (0, 24))
PARTS = {       # rows and columns of the zones of each histogram frame
    0: [(range(8), columns) for columns in (range(4), range(4, 8))],
    2: [(range(16), columns) for columns in HALVES_16],
    3: [(range(first, 32, 2), columns) for first in (0, 1) for columns in COLUMNS_32],
    5: [(range(first, 32, 2), columns) for first in (0, 1) for columns in COLUMNS_48],
}
SIZES = {0: (8, 8, 256), 2: (16, 16, 64), 3: (32, 32, 64), 5: (32, 48, 64)}


def pulse(bins: int, center, sigma: float = 0.8) -> np.ndarray:
    """A pulse of sum 1 around `center` [...], [..., bins]."""
    return np.exp(-0.5 * ((np.arange(bins) - np.asarray(center, float)[..., None]) / sigma)**2) / (sigma * 2.5066)


def zones_16(range_m, photons: float = 5000) -> np.ndarray:
    """Histograms of 16 × 16 zones at these ranges, the last bins not measured, as the device leaves them."""
    zones = AMBIENT + photons * pulse(64, REFERENCE_AT + np.broadcast_to(range_m, (16, 16)) / BIN_M)
    zones[..., 55:] = 0
    return np.round(zones).astype(int)


def references(parts: int) -> np.ndarray:
    """Four reference histograms for each part."""
    return np.round(50_000 * pulse(64, np.full(4 * parts, REFERENCE_AT))).astype(int)


def message(zones: np.ndarray, mode: int = 2, parts=None, results: bool = True) -> bytes:
    """A message of the TMF8829 publisher with these zones; only some parts of them if asked to."""
    frames = [frame(0x10 | mode, 0x19, bytes(256 * 9))] if results else []
    for part, (rows, columns) in enumerate(PARTS[mode]):
        if parts is None or part in parts:
            inside = zones[np.ix_(rows, columns)].reshape(-1)
            values = np.concatenate([references(1).reshape(-1), inside]).astype("<u4")
            frames.append(frame(0x20 | mode, part, values.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()))
    frames.append(bytes(5) + struct.pack("<BBH", 0x30 | mode, 0, 56) + bytes(56))
    body = b"".join(frames)
    return struct.pack("<IB3xI", 0xFE5E1234, 2, 76 + len(body)) + bytes(72) + body


def frame(kind: int, layout: int, data: bytes) -> bytes:
    """5 bytes of the host, header, data, footer."""
    header = struct.pack("<BBHIbbbBHH", kind, layout, 12 + len(data) + 12, 7, 25, 25, 25, 0, 0, 0)
    return bytes(5) + header + data + struct.pack("<IIBBH", 0, 0, 1, 0, 0xE0F7)


def tmf8829_log(path: Path, frames: list[np.ndarray]) -> Path:
    """A log of the driver's logger."""
    sets = [{"info": {"systick_t0": 53_301_248 + 33_000 * k, "systick_t1": 53_283_768 + 33_000 * k},
             "mp_histo": [[{"bin": zone.tolist()} for zone in row] for row in zones],
             "ref_histo": [{"bin": one.tolist()} for one in references(2)]} for k, zones in enumerate(frames)]
    path.write_text(json.dumps({"configuration": {"histogram_bins": 218, "bin_shift": 2}, "Result_Set": sets}))
    return path


def zones_mm(photons: Reading) -> np.ndarray:
    """Reconstructed ranges of the zones, float [rows, cols], NaN without a surface."""
    sensor, frequencies = photons.sensor, choose_frequencies("auto", photons.sensor)
    cloud = Pooled(sensor, frequencies, device="cpu")(sketch_photons(photons.frame, sensor, frequencies))
    ranges = np.full((sensor.rows, sensor.cols), np.nan)
    ranges[cloud.row, cloud.col] = sensor.range_m(cloud.depth_bins) * 1e3
    return ranges
