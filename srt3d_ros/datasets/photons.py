"""Photons: what every photon file gives, whatever its format."""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require

MAX_PHOTONS = 2**28


@dataclass(frozen=True, eq=False)
class Photons:
    """One frame of photons with all that is known about it.

    Args:
        sensor: the sensor that saw them.
        frame: the photons; they all lie inside the sensor's pixels and bins.
        reference_depth_bins: float32 [S, rows, cols], reference depths of S surfaces in the sensor's bins (see
            SensorModel), NaN = unknown or no surface; None if the file has none.
        name: the file's name without its suffix.
        notes: one line each for what was assumed, estimated or left out on the way. Show them to the user.
        reference_intensity: float32, shape of the reference depths, expected signal photons of the surfaces in the
            frame, NaN = unknown; None if the file has none.
    """

    sensor: SensorModel
    frame: PhotonEvents
    reference_depth_bins: np.ndarray | None
    name: str
    notes: tuple[str, ...] = ()
    reference_intensity: np.ndarray | None = None

    def gated(self, first: int, bins: int) -> "Photons":
        """Only the bins [first, first + bins): photons outside are dropped, which a note says with their number."""
        require(first + bins <= self.sensor.num_bins, "gate", f"{first}, {bins}",
                f"first bin and number of bins within the {self.sensor.num_bins} bins of the file")
        events, note = gate_events(self.frame, first, bins)
        shape = self.sensor.background_shape
        sensor = self.sensor.replace(num_bins=bins, toa_offset_bins=self.sensor.toa_offset_bins + first,
                                     background_shape=None if shape is None else shape[first:first + bins])
        reference = self.reference_depth_bins
        if reference is not None:
            moved = reference - np.float32(first)
            reference = np.where((moved >= 0) & (moved < bins), moved, np.float32(np.nan))
        return replace(self, sensor=sensor, frame=events, reference_depth_bins=reference, notes=self.notes + note)


def gate_events(events: PhotonEvents, first: int, bins: int) -> tuple[PhotonEvents, tuple[str, ...]]:
    """The photons in bins [first, first + bins), counted from `first`, and a note if any lie outside."""
    inside = (events.toa >= first) & (events.toa < first + bins)
    dropped = events.photons - int(np.count_nonzero(inside))
    kind = np.float32 if events.toa.dtype == np.float32 else np.uint16
    toa = (events.toa[inside] - events.toa.dtype.type(first)).astype(kind, copy=False)
    gated = PhotonEvents(events.pixel[inside], toa, events.stamp_ns)
    note = f"{dropped} of {events.photons} photons lie outside the gate (bins {first} to {first + bins - 1}): dropped"
    return gated, (note,) if dropped else ()
