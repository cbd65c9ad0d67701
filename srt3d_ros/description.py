"""What is in a photon file, in figures: its size, SBR, IRF, and what it would be sketched with."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from srt3d_ros.core.sketching.design import SketchDesign, design_for, histogram, signal_to_background
from srt3d_ros.core.sketching.gate import AUTO
from srt3d_ros.core.sketching.photons import PhotonHistograms
from srt3d_ros.datasets.photons import Photons

HALF = 0.5                  # of the peak, where an IRF's width is measured
WORD_BYTES = 4              # of each real number of a sketch, and of the count beside them


@dataclass(frozen=True, eq=False)
class Description:
    """Figures of a photon file.

    Args:
        photons: those that are described.
        design: the suggested gate, and frequencies.
        sbr: as of `signal_to_background`.
        histogram, counts: float64 [T] and [rows, cols], photons in each bin and in each pixel.
    """

    photons: Photons
    design: SketchDesign
    sbr: float
    histogram: np.ndarray
    counts: np.ndarray

    @cached_property
    def irf_width_bins(self) -> float:
        """Full width at half maximum of the mean IRF, by linear interpolation."""
        mean = np.pad(np.atleast_2d(self.photons.sensor.irf).mean(axis=0), 1)
        peak, half = int(mean.argmax()), HALF * mean.max()
        left = peak - int(np.argmax(mean[peak::-1] <= half))
        right = peak + int(np.argmax(mean[peak:] <= half))
        before = left + (half - mean[left]) / (mean[left + 1] - mean[left])
        return float(right - (half - mean[right]) / (mean[right - 1] - mean[right]) - before)

    @property
    def facts(self) -> dict:
        """All figures by name; None where a value is unknown or infinite."""
        sensor, (gate, frequencies) = self.photons.sensor, self.design
        used = self.counts if sensor.mask is None else self.counts[sensor.mask]
        return {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                "bin_width_s": sensor.bin_width_s,
                "range_m": sensor.range_m([0, sensor.num_bins]).tolist(), "photons": round(self.counts.sum()),
                "photons_per_pixel": float(used.mean()) if used.size else 0.0,
                "most_photons_in_a_pixel": round(used.max(initial=0)),
                "empty_pixels": int(np.count_nonzero(used <= 0)), "sbr": self.sbr if np.isfinite(self.sbr) else None,
                "irf_width_bins": self.irf_width_bins, "irf_width_s": self.irf_width_bins * sensor.bin_width_s,
                "gate": None if gate is None else [gate.first, gate.last], "frequencies": list(frequencies),
                "sketch_bytes": sensor.pixels * WORD_BYTES * (2 * len(frequencies) + 1),
                "notes": list(self.photons.notes)}


def describe(photons: Photons) -> Description:
    """Figures of photons."""
    frame, sensor = photons.frame, photons.sensor
    suggested = design_for(sensor, AUTO, frame=frame), signal_to_background(histogram(frame, sensor), sensor)
    if isinstance(frame, PhotonHistograms):
        counts = frame.on_axis(sensor)
        return Description(photons, *suggested, *(counts.sum(axis=axis, dtype=np.float64) for axis in ((0, 1), 2)))
    counts = np.bincount(frame.pixel, minlength=sensor.pixels).reshape(sensor.rows, sensor.cols)
    toa = np.bincount(sensor.toa_bins(frame.toa), minlength=sensor.num_bins)
    return Description(photons, *suggested, toa.astype(np.float64), counts.astype(np.float64))
