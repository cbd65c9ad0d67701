"""Reading: one frame of a device, and what adapters of devices share."""

import gzip
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.photons import PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.files import naming_file, require_file
from srt3d_ros.errors import require

MAX_LOG_BYTES = 2**28       # of text, unpacked: a parsed log takes some five times as much
HEAD_BYTES = 2**16          # in which a log shows whose it is
# Σ |h − h'| of two impulse responses of sum 1 from which they are others: by then a pulse has moved by 0.04 bins, and
# the 10⁵ photons of a reference histogram differ by 0.01 from chance.
ANOTHER_PULSE = 0.02


class Reading(NamedTuple):
    """One frame of a device.

    Args:
        sensor: describes it, with the reference pulse of this frame as IRF where the device sends one.
        frame: its histograms, stamped by the device's clock; 0 where the log has no time.
        notes: a line for each assumption.
    """

    sensor: SensorModel
    frame: PhotonHistograms
    notes: tuple[str, ...] = ()


class Steady:
    """The description of a stream, until another one tells something new: each reference pulse has its own noise."""

    def __init__(self):
        self._sensor: SensorModel | None = None

    def sensor(self, newest: SensorModel) -> SensorModel:
        """The description in force, the same object while it holds."""
        before = self._sensor
        if before is None or before.irf.shape != newest.irf.shape or not before.same_as(
                newest.replace(irf=before.irf, irf_ref=before.irf_ref, toa_offset_bins=before.toa_offset_bins)) \
                or np.abs(before.irf - newest.irf).sum(axis=-1).max() > ANOTHER_PULSE:
            self._sensor = newest
        return self._sensor


def head(path: Path) -> str:
    """The beginning of a log, unpacked where it ends in .gz; characters that are no text are left out."""
    require_file(path, "log")
    return _read(path, HEAD_BYTES).decode("utf-8", "ignore")


def text(path: Path) -> str:
    """The text of a log; InvalidInput if it is too long, damaged or not UTF-8."""
    require_file(path, "log")
    data = _read(path, MAX_LOG_BYTES + 1)
    require(len(data) <= MAX_LOG_BYTES, path.name, f"more than {MAX_LOG_BYTES} bytes", "a shorter log: split it")
    with naming_file(path, "text in UTF-8"):
        return data.decode("utf-8-sig")


def json_log(path: Path) -> dict | list:
    """The content of a JSON log."""
    content = text(path)
    with naming_file(path, "a whole log in JSON"):
        return json.loads(content)


def counts(field: str, rows: list, shape: tuple[int, ...]) -> np.ndarray:
    """Nested lists as int32 counts; InvalidInput unless they are numbers of this shape, −1 for any length."""
    try:
        values = np.array(rows, np.float64)
    except (ValueError, TypeError, OverflowError):
        values = np.empty(0)
    fits = values.ndim == len(shape) and all(wanted in (-1, found) for wanted, found in zip(shape, values.shape))
    sizes = " × ".join("n" if wanted < 0 else str(wanted) for wanted in shape)
    require(fits and values.size > 0 and bool((np.abs(values) < 2**31).all()), field, f"{values.shape} values",
            f"{sizes} whole numbers")
    return values.astype(np.int32)


def _read(path: Path, most: int) -> bytes:
    with naming_file(path, "a whole log"), (gzip.open if path.suffix == ".gz" else open)(path, "rb") as stream:
        return stream.read(most)
