"""Sony AS-DT1: raw histogram frames, as its USB video interface sends them.

    v4l2-ctl -d /dev/video0 --stream-mmap --stream-count=100 --stream-to=scan.asdt1

in its histogram output mode, which Sony's driver sets (`output_format: XYZITR`). The layout is that of
https://github.com/sony/as-dt1-ros2-driver (hist_frame.h, dt1_device_hist.cpp): 6 (30M30F), 12 or 24 (20M) banks of 48
dots with 144 bins each, and of each dot the device's own three peaks. Without a device or a recording nothing is
verified. The source tells neither the width of a bin nor time zero, rays or pulse: all are taken from the device's own
peaks, radial distance against bin, direction against column and row; an error says so where these do not fit a line.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from srt3d_ros.core.photons import PhotonHistograms
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.datasets.files import require_file
from srt3d_ros.devices.reading import Reading
from srt3d_ros.errors import require

SENSOR = "Sony AS-DT1: 24 × 24 or 12 × 24 dots of 144 bins"
READS = "raw frames of its video interface, FILE.asdt1"
SUFFIX = ".asdt1"
COLS, BINS, UNIT_M = 24, 144, 1 / 4000
PEAK = np.dtype([(name, "<u4") for name in ("radial", "x", "y", "z", "height", "err")])
DOT = np.dtype([("reserved", "V4"), ("bins", "<u4", BINS), ("noise", "V20"), ("first", PEAK), ("others", "V48")])
BANK = np.dtype([("head", "V138"), ("bank", "u1"), ("more", "V509"), ("cpu_ms", "<u4"), ("rest", "V692"),
                 ("dots", DOT, 48)])
ROWS = {6: (0, 6, 2, 8, 4, 10), 12: (0, 12, 4, 16, 8, 20, 1, 13, 5, 17, 9, 21)}    # of each bank's first 24 dots
SECOND = {6: 1, 12: 2}      # rows from there to the other 24
HALF_PULSE = 8              # bins on either side of a peak that are taken for its pulse
FEWEST = 24                 # dots with a peak of the device, to learn bins and rays from
MOST_OFF = 1.0              # bins, columns, rows: median distance of what is learned from its line


def read(path: Path) -> Iterator[Reading]:
    """The frames of a recording; InvalidInput where it is none."""
    require_file(path, "log")
    size = path.stat().st_size
    require(size > 0 and size % BANK.itemsize == 0, path.name, f"{size} bytes", f"banks of {BANK.itemsize} bytes")
    banks = np.memmap(path, BANK, "r")
    number = 1 + int(banks["bank"][:24].max())
    require(number in (6, 12, 24) and len(banks) % number == 0, path.name, f"{len(banks)} banks of {number}",
            "frames of 6, 12 or 24 banks")
    frames = banks.reshape(-1, number)[:, :12]      # of 24 the first 12: the others expose the same dots longer
    sensor = _learned(frames, path.name)
    notes = ("bin width, time zero, rays and pulse are learned from the device's own peaks",)
    for frame in frames:
        counts = _arranged(frame["dots"]["bins"]).astype(np.float32)
        yield Reading(sensor, PhotonHistograms(counts, int(frame["cpu_ms"][0]) * 1_000_000), notes)


def _arranged(values: np.ndarray) -> np.ndarray:
    """Values [banks, 48, …] of dots as [rows, 24, …]."""
    first = np.array(ROWS[len(values)])
    out = np.zeros((2 * len(values), COLS, *values.shape[2:]), values.dtype)
    out[first], out[first + SECOND[len(values)]] = values[:, :COLS], values[:, COLS:]
    return out


def _learned(frames: np.ndarray, name: str) -> SensorModel:
    """The sensor, from the device's first peaks in all frames."""
    peaks = np.stack([_arranged(frame["dots"]["first"]) for frame in frames])
    counts = np.stack([_arranged(frame["dots"]["bins"]) for frame in frames]).astype(np.float64)
    counts -= np.median(counts, axis=-1, keepdims=True)
    top = counts.argmax(axis=-1)
    x, y = (np.where(peaks[axis] & 0x200000, peaks[axis].astype(np.int64) - 0x400000, peaks[axis]) for axis in "xy")
    seen = (peaks["err"] == 0) & (peaks["z"] > 0) & (top >= HALF_PULSE) & (top < BINS - HALF_PULSE)
    require(int(seen.sum()) >= FEWEST, name, f"{int(seen.sum())} dots with a peak", f"{FEWEST} or more, to learn from")
    _, row, col = np.nonzero(seen)
    bin_m, zero_m = _line(top[seen], peaks["radial"][seen] * UNIT_M, f"{name} bins")
    ray_x, first_x = _line(col, -y[seen] / peaks["z"][seen], f"{name} columns")
    ray_y, first_y = _line(row, x[seen] / peaks["z"][seen], f"{name} rows")
    around = top[seen][:, None] + np.arange(-HALF_PULSE, HALF_PULSE + 1)
    pulse = np.maximum(np.take_along_axis(counts[seen], around, axis=1).sum(axis=0), 0)
    return SensorModel(counts.shape[1], COLS, BINS, 2 * bin_m / SPEED_OF_LIGHT, pulse, HALF_PULSE,
                       toa_offset_bins=zero_m / bin_m, projection=Pinhole(
                           1 / ray_x, 1 / ray_y, -first_x / ray_x, -first_y / ray_y), frame_id="as_dt1")


def _line(at: np.ndarray, value: np.ndarray, field: str) -> tuple[float, float]:
    """Slope and value at 0 of the line through most of the points (iterated L1 fit); InvalidInput if there is none."""
    at, weight = at.astype(np.float64), np.ones(len(at))
    require(np.ptp(at) >= 2, field, f"{np.ptp(at):g} apart", "peaks 2 or more apart, to learn from")
    for _ in range(30):
        slope, first = np.polyfit(at, value, 1, w=np.sqrt(weight))
        off = np.abs(slope * at + first - value)
        weight = 1 / np.maximum(off, 1e-6)
    require(slope > 0 and float(np.median(off)) < MOST_OFF * slope, field, "no line", "the device's peaks on a line")
    return float(slope), float(first)
