"""ams TMF8829: JSON logs of ams' Python driver (https://github.com/ams-OSRAM/tmf8829_driver_python), maybe in gzip.

A measurement comes in parts: four reference histograms each, and those of half the zones (16 × 16), or of an eighth or
a twelfth. The device's T bins end in one that is measured in part, which is left out.

Verified on a log of 26 frames of 16 × 16 zones: bin width, time zero, rays, the device's clock. From the driver's
source only, for want of a device: 8 × 8, 32 × 32 and 48 × 32 zones, the reference pulse where bins are narrower than
its own (8 × 8).
"""

import gzip
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.values import whole_counts
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files.array_files import read_errors

NAME = "tmf8829"
NOTE = "ranges count from the reference pulse"
CONVERTER_S = 200e-12       # of its time-to-digital converter; histograms sum 2^bin_shift of these
MEASURED = 218              # of these, unless the configuration says otherwise; messages do not tell it
REFERENCE_BINS = 64
SIZES = {0: (8, 8), 1: (8, 8), 2: (16, 16), 3: (32, 32), 4: (32, 32), 5: (32, 48)}      # rows, columns by mode
TICK_NS = 1000              # 26 frames of 33 ms are so far apart
# Of a log, some 300 frames, below 0.5 GB: its text is there twice, a number takes up to 32 bytes, a list up to 250.
MOST = {"bytes": 3 * 2**26, "values": 2**23, "lists and objects": 2**20}


def frames(path: Path, options: dict) -> Iterator[Photons]:
    """The frames of a log, stamped by the device's clock, with options (options.gathered) in place of what it says.

    Raises:
        InvalidInput: no whole log, or at the frame that is broken.
    """
    name, (sets, configuration) = path.name, _read(path)
    for k, frame in enumerate(sets):
        try:
            photons = _of_log(frame, configuration, f"{name} frame {k}")
        except InvalidInput:
            raise
        except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError) as error:
            raise InvalidInput(f"{name} frame {k}", f"without {error}", "mp_histo and ref_histo") from None
        yield replace(photons, name=path.stem).with_options(options)


def _read(path: Path) -> tuple[list, dict]:
    """The frames and the configuration that a log has."""
    with read_errors(path, "a whole log in JSON"), (gzip.open if path.suffix == ".gz" else open)(path, "rb") as stream:
        sizes, at = Counter(), 0
        while part := stream.read(2**20):       # counted first: a text that grows takes twice the memory
            sizes.update({"bytes": len(part), "values": part.count(b","),
                          "lists and objects": part.count(b"[") + part.count(b"{")})
            for what, most in MOST.items():
                require(sizes[what] <= most, "size", f"more than {most} {what}", "a shorter log: split it")
        raw = bytearray(sizes["bytes"])
        stream.seek(0)
        while part := stream.read(2**20):
            raw[at:at + len(part)] = part
            at += len(part)
        log = json.loads(raw.decode("latin-1").removeprefix("\xef\xbb\xbf"))      # one byte a character, also of names
    sets, configuration = (log.get(key) if isinstance(log, dict) else None for key in ("Result_Set", "configuration"))
    require(isinstance(sets, list) and sets, f"{path.name} Result_Set", "absent or empty",
            "a list of frames: log with combined_results and histograms")
    return sets, configuration if isinstance(configuration, dict) else {}


def _of_log(frame: dict, configuration: dict, name: str) -> Photons:
    zones = whole_counts(f"{name} mp_histo", [[zone["bin"] for zone in row] for row in frame["mp_histo"]], (-1, -1, -1))
    references = whole_counts(f"{name} ref_histo", [one["bin"] for one in frame["ref_histo"]], (-1, REFERENCE_BINS))
    require(zones.shape[:2] in SIZES.values(), f"{name} mp_histo", zones.shape[:2], "8 × 8 to 32 × 48 zones")
    mode = next(mode for mode, size in SIZES.items() if size == zones.shape[:2])
    parts = parts_of(mode)
    require(len(references) == 4 * parts, f"{name} ref_histo", len(references), f"{4 * parts} histograms")
    info = frame.get("info", {})
    stamp_ns = min(int(info.get("systick_t0", 0)), int(info.get("systick_t1", 0))) * TICK_NS
    steps, shift = int(configuration.get("histogram_bins", MEASURED)), configuration.get("bin_shift", shift_of(mode))
    require(shift in range(3), f"{name} bin_shift", shift, "0, 1 or 2")
    photons = photons_of(zones, references.reshape(-1, 4, REFERENCE_BINS).sum(axis=1), mode, stamp_ns, shift, steps)
    if mode != 2 or not zones.any() or (zones != zones[:, :1]).any():
        return photons
    # Seen in a log of the logger's version 4: all histograms of its row y are that of zone y of row 0.
    sensor = photons.sensor.replace(rows=1, irf=photons.sensor.irf[:zones.shape[1]])
    row = PhotonHistograms(photons.frame.counts[None, :, 0].copy(), stamp_ns)
    return Photons(sensor, row, None, NAME, (NOTE, "a fault of the logger: the log has the histograms of row 0 only"))


def photons_of(zones: np.ndarray, references: np.ndarray, mode: int, stamp_ns: int, shift: int, steps: int) -> Photons:
    """Zones [rows, cols, bins], each bin 2^shift steps wide, and the references [parts, 64] of their parts."""
    rows, cols, bins = zones.shape
    bins = min(steps >> shift, bins)        # the last whole one
    of_part = np.zeros((rows, cols), np.intp)
    for part in range(len(references)):
        of_part[zones_of(part, mode)] = part
    pulses = np.repeat(references, 1 << (2 - shift), axis=1)[:, :bins]      # as wide as the zones' bins
    peak = int(pulses.sum(axis=0).argmax())
    projection = Pinhole(0.75 * cols, rows, (cols - 1) / 2, (rows - 1) / 2)
    sensor = SensorModel(rows, cols, bins, CONVERTER_S * 2**shift, pulses[of_part.ravel()], peak,
                         toa_offset_bins=-peak, projection=projection, frame_id=NAME)
    frame = PhotonHistograms(np.ascontiguousarray(zones[..., :bins]), stamp_ns)
    return Photons(sensor, frame, None, NAME, (NOTE,))


def shift_of(mode: int) -> int:
    """log₂ of the converter's steps in a bin: 256 bins in the 8 × 8 modes, 64 in the others."""
    return 0 if mode < 2 else 2


def _step(mode: int) -> int:
    """Columns from one zone of a part to the next."""
    return {3: 2, 4: 2, 5: 3}.get(mode, 1)


def parts_of(mode: int) -> int:
    """Histogram frames of a measurement."""
    return 2 * _step(mode) * max(SIZES[mode][0] // 16, 1)


def zones_of(part: int, mode: int) -> tuple[slice, slice]:
    """The zones of a part: in turn the left and the right half, then the columns between, then the rows between."""
    (rows, cols), step = SIZES[mode], _step(mode)
    first = part % 2 * (cols // 2)
    return slice(part // (2 * step), None, max(rows // 16, 1)), slice(first + part // 2 % step, first + cols // 2, step)
