"""What is in a photon file, in figures: its size, light, IRF, and what it would be sketched with."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.frame_watch import FrameHistogram, frame_histogram
from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE
from srt3d_ros.core.gate import AUTO, Gate
from srt3d_ros.core.light import Light
from srt3d_ros.core.sketch_design import SketchDesign, design_for
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.stream import PhotonStream

HALF = 0.5                  # of the peak, where an IRF's width is measured
SKETCH_BYTES = 4            # of each real number of a sketch, and of the count beside it


@dataclass(frozen=True, eq=False)
class Description:
    """Figures of a photon file.

    Args:
        photons: of the file, or a sample of pixels that stands for it.
        total: number of photons in the file.
        histogram: of all pixels of `photons`.
        light: ppp and SBR.
        gate: that the histogram suggests, or None for all bins.
        frequencies: that the light suggests, for the gate.
        irf_width_bins: full width at half maximum of the mean IRF.
    """

    photons: Photons
    total: int
    histogram: FrameHistogram
    light: Light
    gate: Gate | None
    frequencies: tuple[int, ...]
    irf_width_bins: float

    @property
    def facts(self) -> dict:
        """All of it by name, for JSON."""
        sensor, gate = self.photons.sensor, self.gate
        nearest, farthest = sensor.range_m([0, sensor.num_bins])
        counts = np.bincount(self.photons.frame.pixel, minlength=sensor.pixels)
        used = counts if sensor.mask is None else counts[sensor.mask.ravel()]
        return {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins, "bin_width_s": sensor.bin_width_s,
                "range_m": [float(nearest), float(farthest)], "photons": self.total,
                "photons_per_pixel": self.total / sensor.pixels, "most_photons_in_a_pixel": int(used.max(initial=0)),
                "empty_pixels": float(np.mean(used == 0)) if len(used) else 1.0,
                "sbr": self.light.sbr if np.isfinite(self.light.sbr) else None,
                "irf_bins": int(sensor.irf.shape[-1]), "irf_width_bins": self.irf_width_bins,
                "irf_width_s": self.irf_width_bins * sensor.bin_width_s, "irf_per_pixel": sensor.irf.ndim == 2,
                "gate": None if gate is None else [gate.first, gate.last], "frequencies": list(self.frequencies),
                "sketch_bytes": sensor.pixels * SKETCH_BYTES * (2 * len(self.frequencies) + 1),
                "surfaces_in_reference": 0 if self.photons.reference_depth_bins is None
                else len(self.photons.reference_depth_bins), "notes": list(self.photons.notes)}


def describe(photons: Photons | PhotonStream, sketch_size: int = DEFAULT_SKETCH_SIZE) -> Description:
    """Figures of photons that `open_stream` gave; of a stream, all but the number of photons from its sample."""
    shown, total = photons, photons.photons if isinstance(photons, PhotonStream) else photons.frame.photons
    if isinstance(photons, PhotonStream):
        shown = photons.sample
    histogram = frame_histogram(shown.frame, shown.sensor)
    design: SketchDesign = design_for(shown.frame, shown.sensor, AUTO, sketch_size=sketch_size)
    light = design.light or Light(total / shown.sensor.pixels, 0.0, 0)
    return Description(shown, round(total), histogram, light, design.gate, design.frequencies, _width(shown.sensor.irf))


def _width(irf: np.ndarray) -> float:
    """Full width at half maximum, bins, between the crossings beside the peak; by linear interpolation."""
    mean = np.pad(np.atleast_2d(irf).mean(axis=0), 1)
    peak, half = int(mean.argmax()), HALF * mean.max()
    left = peak - int(np.argmax(mean[peak::-1] <= half))
    right = peak + int(np.argmax(mean[peak:] <= half))
    before = left + (half - mean[left]) / (mean[left + 1] - mean[left])
    after = right - (half - mean[right]) / (mean[right - 1] - mean[right])
    return float(after - before)
