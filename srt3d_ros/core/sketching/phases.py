"""Tables of the phases exp(i ω_l x) of bins. The last column is 1 + 0i where a bin is inside the gate: it counts."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate

FAR = 4.0               # times its mean: where a template is higher, its noise would be taken for a surface


def phase_table(sensor: SensorModel, frequencies, gate: Gate | None, middles: np.ndarray | None = None) -> np.ndarray:
    """exp(i ω_l x) for bins of a sensor, re and im interleaved, then 1 and 0; zeros for bins outside the gate.

    Args:
        middles: of the bins, counted in the sensor's own; unless given, those of the sensor's own, 0.5, 1.5, …

    Returns:
        float32 [n, 2m + 2].
    """
    middles = np.arange(sensor.num_bins) + 0.5 if middles is None else middles
    start, num_bins = (0, sensor.num_bins) if gate is None else (gate.start, gate.num_bins)
    from_start = (middles - start) % sensor.num_bins
    # In half bins, so that k·x of the sensor's own is a whole number and the phase is exact for large k·x.
    half_bins, period = 2 * (from_start + sensor.first_bin_center) - 1, 2 * num_bins
    turns = np.outer(half_bins, (*frequencies, 0)) % period / period
    phases = np.exp(2j * np.pi * turns) * (from_start < num_bins)[:, None]
    return phases.astype(np.complex64).view(np.float32)


def histogram_tables(sensor: SensorModel, frequencies, gate: Gate | None) -> tuple[np.ndarray, np.ndarray | None]:
    """The phases of the bins of a sensor's histograms, and the phase sums of their template, or None.

    Bins in which the template is far above its mean are taken to hold the mean of the others inside the gate, whatever
    they count: a uniform background still adds nothing.

    Returns:
        float32 [n, 2m + 2]; and [2m + 2], or [rows · cols, 2m + 2] if pixels have templates of their own.
    """
    bins = sensor.histograms
    table = phase_table(sensor, frequencies, gate, None if bins is None else bins.centers())
    if bins is None or bins.template is None:
        return table, None
    of_pixel = bins.template.reshape(-1, bins.num_bins).mean(axis=0)
    left_out = (of_pixel > max(FAR * of_pixel.mean(), 1))[:, None]
    others = (table[:, -2:-1] > 0) & ~left_out
    mean = (table * left_out).sum(axis=0) / max(others.sum(), 1)
    table = ((table + mean) * others).astype(np.float32)
    return table, bins.template @ table
