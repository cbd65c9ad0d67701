"""Figures of a photon file: size, SBR, IRF width, and the gate and frequencies that suit it."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor.pulse import full_width_at_half_maximum
from srt3d_ros.core.sketching.design import design_sketch, histogram, signal_to_background
from srt3d_ros.core.sketching.gate import AUTO, Gate
from srt3d_ros.core.sketching.plausibility import light_of
from srt3d_ros.datasets.reading import Reading

WORD_BYTES = 4              # of each real number and of the count in a sketch


@dataclass(frozen=True, eq=False)
class Description:
    """Figures of a photon file."""

    facts: dict                 # by name; None if unknown or infinite
    gate: Gate | None           # suggested
    histogram: np.ndarray       # photons in each bin, float64 [T]
    counts: np.ndarray          # photons in each pixel, float64 [rows, cols]


def describe(photons: Reading) -> Description:
    """Compute the figures of photons."""
    frame, sensor = photons.frame, photons.sensor
    gate, frequencies = design_sketch(sensor, AUTO, frame=frame)
    sbr = signal_to_background(histogram(frame, sensor), sensor)
    light = light_of(frame, sensor)
    used = light.of_pixels[sensor.used]
    irf_width_bins = full_width_at_half_maximum(sensor)
    facts = {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins, "bin_width_s": sensor.bin_width_s,
             "range_m": sensor.range_m([0, sensor.num_bins]).tolist(), "photons": round(light.of_pixels.sum()),
             "photons_per_pixel": float(used.mean()) if used.size else 0.0,
             "most_photons_in_a_pixel": round(used.max(initial=0)),
             "empty_pixels": int(np.count_nonzero(used <= 0)), "sbr": sbr if np.isfinite(sbr) else None,
             "irf_width_bins": irf_width_bins, "irf_width_s": irf_width_bins * sensor.bin_width_s,
             "gate": None if gate is None else [gate.first, gate.last], "frequencies": list(frequencies),
             "sketch_bytes": sensor.pixels * WORD_BYTES * (2 * len(frequencies) + 1), "notes": [*photons.notes]}
    return Description(facts, gate, light.of_bins, light.of_pixels)
