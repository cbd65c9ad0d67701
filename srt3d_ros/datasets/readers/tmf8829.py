"""Read JSON logs of the ams TMF8829's Python driver (https://github.com/ams-OSRAM/tmf8829_driver_python), also .gz.

A measurement has several parts, each with four reference histograms and the histograms of half the zones (16 × 16), an
eighth (32 × 32) or a twelfth (32 × 48). The device measures the last bin only in part; it is left out.

Verified on a log of 26 frames of 16 × 16 zones: bin width, time zero, rays, clock. Taken from the driver's source
without a device: the other modes, and the reference pulse where bins are narrower than its own (8 × 8).
"""

import gzip
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.datasets.arrays import from_frame
from srt3d_ros.datasets.options import Options, fields_of
from srt3d_ros.datasets.reading import Reading, Said
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_errors

FRAME_ID = "tmf8829"
NOTE = "ranges count from the reference pulse"
CONVERTER_S = 200e-12       # step of the time-to-digital converter; a bin has 2^bin_shift steps
MEASURED = 218              # steps in a histogram unless the configuration says otherwise; messages do not tell
REFERENCE_BINS = 64
SIZES = {0: (8, 8), 1: (8, 8), 2: (16, 16), 3: (32, 32), 4: (32, 32), 5: (32, 48)}      # rows, columns by mode
TICK_NS = 1000              # of the device's clock: 26 frames of 33 ms agree
# Limits of a log, for about 300 frames in 0.7 GB: its text is in memory twice, a number takes 32 bytes, a list 250.
MAX_LOG_BYTES, MAX_VALUES, MAX_LISTS = 3 * 2**26, 2**23, 2**20


def frames(path: Path, options: Options) -> Iterator[Callable[[], Reading]]:
    """Yield functions that give the frames of a log, stamped by the device's clock; `options` override the log."""
    sets, configuration = _read(path)
    for k, frame in enumerate(sets):
        yield partial(_photons, frame, configuration, path, k, options)


def _photons(frame: dict, configuration: dict, path: Path, number: int, options: Options) -> Reading:
    with read_errors(path, f"mp_histo and ref_histo in frame {number}"):
        photons = _of_log(frame, configuration, f"{path.name} frame {number}")
    return from_frame(photons.frame, options, Said(fields_of(photons.sensor), photons.notes, path.stem))


def _read(path: Path) -> tuple[list, dict]:
    """The frames and the configuration of a log."""
    packed = path.suffix.lower() == ".gz"
    require(not packed or path.suffixes[-2:-1] in ([], [".json"]), "photon file",
            problem=f"{path.name} is packed: unpack it first (gunzip {path.name}). Of .gz only logs in JSON are read.")
    opened = gzip.open if packed else open
    with read_errors(path, "a complete log in JSON"), opened(path, "rb") as stream:
        raw = stream.read(MAX_LOG_BYTES + 1)
        lists = raw.count(b"[") + raw.count(b"{")
        for what, size, most in (("bytes", len(raw), MAX_LOG_BYTES), ("values", raw.count(b","), MAX_VALUES),
                                 ("lists and objects", lists, MAX_LISTS)):
            require(size <= most, "size", problem=f"The log has more than {most} {what}: split it.")
        log = json.loads(raw.decode("utf-8-sig"))
    sets, configuration = (log.get(key) if isinstance(log, dict) else None for key in ("Result_Set", "configuration"))
    require(isinstance(sets, list) and sets, f"{path.name} Result_Set",
            problem=f"{path.name} is no log of a TMF8829 with histograms (it has no frames in Result_Set): log with "
            "combined_results and histograms; of other JSON, give from_counts the array; a "
            "description of a sensor is a --sensor-file.")
    return sets, configuration if isinstance(configuration, dict) else {}


def _whole_counts(field: str, lists: list, axes: int) -> np.ndarray:
    """Nested lists as int32 counts; ValueError for lists of unequal length, InvalidInput for other counts of axes."""
    values = np.array(lists, np.float64)
    require(values.ndim == axes and values.size > 0 and bool((np.abs(values) < 2**31).all()), field,
            f"{values.shape} values", f"whole numbers in {axes} dimensions")
    return values.astype(np.int32)


def _of_log(frame: dict, configuration: dict, name: str) -> Reading:
    """The photons of a frame of a log."""
    zones = _whole_counts(f"{name} mp_histo", [[zone["bin"] for zone in row] for row in frame["mp_histo"]], axes=3)
    references = _whole_counts(f"{name} ref_histo", [pulse["bin"] for pulse in frame["ref_histo"]], axes=2)
    mode = next((mode for mode, size in SIZES.items() if size == zones.shape[:2]), None)
    require(mode is not None, f"{name} mp_histo", zones.shape[:2], "8 × 8 to 32 × 48 zones")
    parts = parts_of(mode)
    require(references.shape == (4 * parts, REFERENCE_BINS), f"{name} ref_histo", references.shape,
            f"{4 * parts} histograms of {REFERENCE_BINS} bins")
    info = frame.get("info", {})
    stamp_ns = min(int(info.get("systick_t0", 0)), int(info.get("systick_t1", 0))) * TICK_NS
    steps = int(configuration.get("histogram_bins", MEASURED))
    shift = configuration.get("bin_shift", shift_of(mode))
    require(shift in range(3), f"{name} bin_shift", shift, "0, 1 or 2")
    photons = photons_of(zones, references.reshape(-1, 4, REFERENCE_BINS).sum(axis=1), mode, stamp_ns, shift, steps)
    if mode != 2 or not zones.any() or (zones != zones[:, :1]).any():
        return photons
    # A fault of the logger, version 4: all histograms of row y are that of zone y of row 0.
    sensor = photons.sensor.replace(rows=1, irf=photons.sensor.irf[:zones.shape[1]])
    row = PhotonHistograms(photons.frame.counts[None, :, 0].copy(), stamp_ns)
    return Reading(sensor, row, None, FRAME_ID, (NOTE, "the logger wrote only the histograms of row 0, a known fault"))


def photons_of(zones: np.ndarray, references: np.ndarray, mode: int, stamp_ns: int, shift: int, steps: int) -> Reading:
    """Photons of zones [rows, cols, bins], whose bins have 2^shift steps, and of references [parts, 64]."""
    rows, cols, bins = zones.shape
    bins = min(steps >> shift, bins)        # without the last, measured in part
    of_part = np.zeros((rows, cols), np.intp)
    for part in range(len(references)):
        of_part[zones_of(part, mode)] = part
    pulses = np.repeat(references, 1 << (2 - shift), axis=1)[:, :bins]      # in the zones' bins
    peak = int(pulses.sum(axis=0).argmax())
    projection = Pinhole(0.75 * cols, rows, (cols - 1) / 2, (rows - 1) / 2)
    sensor = SensorModel(rows, cols, bins, CONVERTER_S * 2**shift, pulses[of_part.ravel()], peak,
                         toa_offset_bins=-peak, projection=projection, frame_id=FRAME_ID)
    frame = PhotonHistograms(np.ascontiguousarray(zones[..., :bins]), stamp_ns)
    return Reading(sensor, frame, None, FRAME_ID, (NOTE,))


def shift_of(mode: int) -> int:
    """log₂ of the steps in a bin: the 8 × 8 modes have 256 bins, the others 64."""
    return 0 if mode < 2 else 2


def _step(mode: int) -> int:
    """Distance in columns between neighbouring zones of a part."""
    return {3: 2, 4: 2, 5: 3}.get(mode, 1)


def parts_of(mode: int) -> int:
    """Number of parts of a measurement."""
    return 2 * _step(mode) * max(SIZES[mode][0] // 16, 1)


def zones_of(part: int, mode: int) -> tuple[slice, slice]:
    """Rows and columns of a part's zones. Parts alternate left and right half, then shift columns, then rows."""
    (rows, cols), step = SIZES[mode], _step(mode)
    first = part % 2 * (cols // 2)
    return slice(part // (2 * step), None, max(rows // 16, 1)), slice(first + part // 2 % step, first + cols // 2, step)
