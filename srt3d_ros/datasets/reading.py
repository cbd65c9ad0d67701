"""Reading: one frame of a file, bag or log as plain data, with its sensor."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.options import Known, backwards
from srt3d_ros.datasets.values import MAX_EVENTS, outside_note
from srt3d_ros.errors import require

IN_MEMORY = "arrays"


@dataclass(frozen=True, eq=False)
class Said:
    """What a source says beside its photons.

    Args:
        sensor: values of its sensor by the names of SensorModel's fields, and fov_deg.
        notes: of the source, and on what was chosen in it.
        name, reference_depth_bins: as of Reading.
        stamp_ns: start of acquisition, nanoseconds.
    """

    sensor: Known = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    name: str = IN_MEMORY
    reference_depth_bins: np.ndarray | None = None
    stamp_ns: int = 0


@dataclass(frozen=True, eq=False)
class Reading:
    """One frame of any source. A large array of counts stays in its file until it is sketched.

    Args:
        sensor: of the frame.
        frame: photons, as events or as histograms, inside the sensor's pixels and bins; or their sketch, or the points
            of a saved cloud.
        reference_depth_bins: float32 [S, rows, cols], reference depths of S surfaces in the sensor's bins (see
            SensorModel), NaN = unknown or no surface; None if the source has none.
        name: the file's name without its suffix.
        notes: a line for each assumption, estimate or omission. Show them to the user.
        frames: number of frames in the source, if it is an array of counts.
    """

    sensor: SensorModel
    frame: PhotonEvents | PhotonHistograms | PhaseSums | PointCloud
    reference_depth_bins: np.ndarray | None = None
    name: str = IN_MEMORY
    notes: tuple[str, ...] = ()
    frames: int = 1

    @property
    def photons(self) -> int:
        """Number of photons."""
        return self.frame.photons

    @property
    def events(self) -> PhotonEvents:
        """The photons one by one; InvalidInput if there are too many, or counts that are negative or fractional."""
        if isinstance(self.frame, PhotonEvents):
            return self.frame
        require(self.photons <= MAX_EVENTS, f"{self.name} photons", problem=f"{self.name} has {self.photons} photons, "
                f"more than the {MAX_EVENTS} that can be listed. Methods on sketches take any number.")
        return self.frame.to_events(self.sensor)

    def gated(self, first: int, last: int) -> Self:
        """Keep the photons in the bins `first` to `last`; a note says how many were dropped."""
        gate, whole = Gate(self.sensor, first, last), self.events
        events = gate.photons(whole)
        note = outside_note(whole.photons - events.photons, whole.photons, first, last)
        if gate.sensor.cycles:
            note += ("pile-up is not corrected: that needs the photons before the gate (give the gate to `sketch`)",)
        # Gate words still count from the bin 0 of the whole period.
        return replace(self, sensor=gate.sensor.replace(gates=self.sensor.gates, cycles=None), frame=events,
                       reference_depth_bins=in_gate(self.reference_depth_bins, first, last), notes=self.notes + note)

    def reversed(self) -> Self:
        """The same frame with times that run the other way: bin b becomes T − 1 − b, of IRF and references, too."""
        sensor, frame, depth = self.sensor, self.frame, self.reference_depth_bins
        last = sensor.num_bins - 1
        require(sensor.histograms is None, "reversed", problem="Histograms of other bins cannot be reversed.")
        if isinstance(frame, PhotonHistograms):
            frame = replace(frame, counts=np.ascontiguousarray(frame.counts[..., ::-1]))
        else:
            require(isinstance(frame, PhotonEvents), "reversed", problem=f"{self.name} has no photons to be reversed.")
            toa = frame.toa if frame.toa.dtype == np.uint16 else frame.toa.astype(np.float64)
            turned = last - toa
            frame = replace(frame, toa=turned if turned.dtype == np.uint16 else sensor.wrapped(turned))
        return replace(self, sensor=backwards(sensor), frame=frame,
                       reference_depth_bins=None if depth is None else last - depth)


def in_gate(depth: np.ndarray | None, first: int, last: int) -> np.ndarray | None:
    """Depths in bins, counted from the bin `first`, NaN outside the gate; None without any."""
    if depth is None:
        return None
    moved = depth - np.float32(first)
    return np.where((moved >= 0) & (moved <= last - first), moved, np.float32(np.nan))
