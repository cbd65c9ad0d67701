"""Photons: one frame with all that is known about it, and the options by which users complete or correct a file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from srt3d_ros.core.gate import Gate
from srt3d_ros.core.photons import COUNT_DTYPES, PhotonEvents, PhotonHistograms
from srt3d_ros.core.projection import DEFAULT_FOV_DEG, Pinhole
from srt3d_ros.core.sensor import MAX_BINS, SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.files import read_text
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.messages import json_text

MAX_PHOTONS = 2**28
MAX_GATE_BIN = 2**31
SENSOR_OPTIONS = tuple(name for name in SensorModel.__dataclass_fields__ if name not in ("rows", "cols", "gates"))
ASSUMED_FOV = (f"geometry taken to be a pinhole of {DEFAULT_FOV_DEG:g}° across the larger side: give fov_deg "
               "(--fov-deg), or the projection")
OPTIONS = ("num_bins", "bin_width_s", "toa_offset_bins", "range_offset_m", "toa_reference", "irf_ref", "irf", "fov_deg",
           "gate", "rows", "cols", "channel")


@dataclass(frozen=True, eq=False)
class Photons:
    """One frame of photons.

    Args:
        sensor: the sensor that saw them.
        frame: the photons, as events or as histograms; they all lie inside the sensor's pixels and bins.
        reference_depth_bins: float32 [S, rows, cols], reference depths of S surfaces in the sensor's bins (see
            SensorModel), NaN = unknown or no surface; None if the file has none.
        name: the file's name without its suffix.
        notes: one line each for what was assumed, estimated or left out on the way. Show them to the user.
        reference_intensity: float32, shape of the reference depths, expected signal photons of the surfaces in the
            frame, NaN = unknown; None if the file has none.
    """

    sensor: SensorModel
    frame: PhotonEvents | PhotonHistograms
    reference_depth_bins: np.ndarray | None
    name: str
    notes: tuple[str, ...] = ()
    reference_intensity: np.ndarray | None = None

    @property
    def events(self) -> PhotonEvents:
        """The photons one by one; InvalidInput for histograms of negative or fractional counts."""
        return self.frame if isinstance(self.frame, PhotonEvents) else self.frame.to_events(self.sensor)

    @property
    def photons(self) -> int:
        """Number of photons."""
        return self.frame.photons

    @property
    def sample(self) -> "Photons":
        """What gate and frequencies are chosen by: all of them. Of a PhotonStream, some."""
        return self

    def read_whole(self) -> "Photons":
        """All photons in memory, which they are."""
        return self

    def with_sensor(self, sensor: SensorModel) -> "Photons":
        """The same photons, of this sensor; InvalidInput if they do not fit it."""
        self.frame.check(sensor)
        return replace(self, sensor=sensor, notes=still_assumed(self.notes, self.sensor, sensor))

    def sketch(self, frequencies, gate: Gate | None = None) -> Sketch:
        """The sketch of all photons, of those inside a gate if there is one."""
        return sketch_photons(self.frame, self.sensor, frequencies, gate)

    def with_options(self, options: dict) -> "Photons":
        """The photons of a file that describes its sensor, with `options` in place of what it says."""
        refuse_channel(options)
        for name in ("rows", "cols"):
            own = getattr(self.sensor, name)
            require(options.get(name, own) == own, name, options.get(name), f"{own}, as in the file")
        photons = self.with_sensor(described(self.sensor, options))
        if "gate" not in options:
            return photons
        first, bins = options["gate"]
        return photons.gated(Gate(photons.sensor, first, first + bins - 1))

    def gated(self, gate: Gate) -> "Photons":
        """Only what is inside a gate of the sensor; a note says how many photons are outside."""
        whole = self.events
        events = gate.photons(whole)
        reference = self.reference_depth_bins
        if reference is not None:
            moved = reference - np.float32(gate.first)
            reference = np.where((moved >= 0) & (moved <= gate.last - gate.first), moved, np.float32(np.nan))
        note = outside_note(whole.photons - events.photons, whole.photons, gate.first, gate.last)
        # The words in which these photons may be sent still count from their own bin 0.
        return replace(self, sensor=gate.sensor.replace(gates=self.sensor.gates), frame=events,
                       reference_depth_bins=reference, notes=self.notes + note)


def still_assumed(notes: tuple[str, ...], before: SensorModel, now: SensorModel) -> tuple[str, ...]:
    """The notes without that on an assumed projection, if another was given since."""
    return notes if now.projection is before.projection else tuple(note for note in notes if note != ASSUMED_FOV)


def outside_note(dropped: int, photons: int, first: int, last: int) -> tuple[str, ...]:
    """The note on photons that a gate drops, if there are any."""
    note = f"{dropped} of {photons} photons lie outside the gate (bins {first} to {last}): dropped"
    return (note,) if dropped else ()


def refuse_channel(options: dict) -> None:
    """Raise InvalidInput if the options choose a channel, for a file without."""
    require("channel" not in options, "channel", options.get("channel"), "nothing: the file tells no channels apart")


def gather_options(path: Path, overrides: dict) -> dict:
    """The options of a photon file: the sidecar's (FILE.json, "head.mat.json" for head.mat), then `overrides` on top.

    An `irf` becomes an array here, one in the sidecar read relative to the sidecar's folder; a `gate` becomes two
    integers. An override of None counts as not given.

    Raises:
        InvalidInput: an unknown name, a broken sidecar, an IRF or a gate that cannot be used.
    """
    sidecar = path.with_name(path.name + ".json")
    options = json_text.parse(read_text(sidecar), sidecar.name) if sidecar.exists() else {}
    _check_names(options, sidecar.name)
    given = {name: value for name, value in overrides.items() if value is not None}
    _check_names(given, "option")
    if "irf" in given:
        given["irf"] = irfs.read(given["irf"])
        options.pop("irf_ref", None)                # it belongs to the IRF that is replaced
    elif "irf" in options:
        options["irf"] = irfs.read(options["irf"], path.parent)
    options |= given
    if "gate" in options:
        options["gate"] = _gate(options["gate"])
    return options


def described(sensor: SensorModel, options: dict) -> SensorModel:
    """The sensor with options in place of its own values; those that do not describe it are left out."""
    changes = {name: value for name, value in options.items() if name in SENSOR_OPTIONS}
    if "irf" in changes:        # irf_ref belongs to the one that is replaced
        changes = {"irf_ref": None} | changes
    if "fov_deg" in options:
        changes["projection"] = pinhole(sensor.rows, sensor.cols, options["fov_deg"])
    return sensor.replace(**changes) if changes else sensor


def sendable(counts: np.ndarray) -> np.ndarray:
    """Counts in a type that histograms may have: of integers the smallest that holds them."""
    if counts.dtype in COUNT_DTYPES and counts.dtype.isnative:
        return counts
    if counts.dtype.kind == "f":
        return counts.astype(np.float32)
    low, high = (int(counts.min()), int(counts.max())) if counts.size else (0, 0)
    kind = next((kind for kind in COUNT_DTYPES[:-1] if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max), None)
    require(kind is not None, "counts", low if low < 0 else high, "32-bit numbers")
    return counts.astype(kind)


def pinhole(rows: int, cols: int, fov_deg: object) -> Pinhole:
    """A pinhole with `fov_deg` across the larger side."""
    return Pinhole.from_fov(rows, cols, number("fov_deg", fov_deg, "an angle between 0 and 180 degrees"))


def check_within(name: str, values: np.ndarray, end: int) -> None:
    """Raise InvalidInput unless all values are 0 or more, and below `end`."""
    if values.size:
        low, high = values.min().item(), values.max().item()        # a NaN makes both NaN
        require(0 <= low and high < end, name, low if high < end else high, f"0 to below {end}")


def number(field: str, value: object, expected: str) -> float:
    """`value` as a finite float, or InvalidInput."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(field, quoted(value), expected) from None
    require(np.isfinite(result), field, quoted(value), expected)
    return result


def positive_integer(field: str, value: object) -> int:
    """`value` as an integer of 1 or more, or InvalidInput."""
    result = number(field, value, "an integer, 1 or more")
    require(result == int(result) >= 1, field, value, "an integer, 1 or more")
    return int(result)


def whole_counts(field: str, rows: object, shape: tuple[int, ...]) -> np.ndarray:
    """Nested lists of a log as int32 counts; InvalidInput unless they are numbers of this shape, -1 for any length."""
    try:
        values = np.array(rows, np.float64)
    except (ValueError, TypeError, OverflowError):
        values = np.empty(0)
    fits = values.ndim == len(shape) and all(wanted in (-1, found) for wanted, found in zip(shape, values.shape))
    sizes = " × ".join("n" if wanted < 0 else str(wanted) for wanted in shape)
    require(fits and values.size > 0 and bool((np.abs(values) < 2**31).all()), field, f"{values.shape} values",
            f"{sizes} whole numbers")
    return values.astype(np.int32)


def _check_names(options: dict, where: str) -> None:
    for name in options:
        require(name in OPTIONS, f"{where} name", quoted(name), f"one of {', '.join(OPTIONS)}")


def _gate(value: object) -> tuple[int, int]:
    expected = f"two integers: first bin, and number of bins from 2 to {MAX_BINS}"
    try:
        first, bins = value
    except (TypeError, ValueError):
        raise InvalidInput("gate", quoted(value), expected) from None
    first, bins = number("gate", first, expected), number("gate", bins, expected)
    valid = first == int(first) and bins == int(bins) and 0 <= first <= MAX_GATE_BIN and 2 <= bins <= MAX_BINS
    require(valid, "gate", quoted(value), expected)
    return int(first), int(bins)
