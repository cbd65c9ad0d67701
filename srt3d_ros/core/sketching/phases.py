"""Tables of the phases exp(i ω_l x) of bins. The last column is 1 + 0i where a bin is inside the gate: it counts."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate

FAR = 4.0               # times its mean: where a template is higher, its noise would be taken for a surface


def phase_table(frequencies, num_bins: int, first_bin_center: float = 0.0) -> np.ndarray:
    """exp(i ω_l x) for the centre x of every bin, re and im interleaved; float32 [T, 2m]."""
    # In half bins, so that k·x is reduced modulo T in integers and the phase is exact for large k·x.
    period = 2 * num_bins
    centers = 2 * np.arange(num_bins) + round(2 * first_bin_center)
    turns = np.outer(centers, np.asarray(frequencies)) % period / period
    return np.exp(2j * np.pi * turns).astype(np.complex64).view(np.float32)


def toa_table(sensor: SensorModel, frequencies, gate: Gate | None) -> np.ndarray:
    """The phases of a sensor's bins; float32 [T, 2m], with a gate [T, 2m + 2], zeros outside: they need no branch."""
    if gate is None:
        return phase_table(frequencies, sensor.num_bins, sensor.first_bin_center)
    table = np.zeros((sensor.num_bins, 2 * len(frequencies) + 2), np.float32)
    inside = (gate.start + np.arange(gate.num_bins)) % sensor.num_bins
    table[inside] = phase_table((*frequencies, 0), gate.num_bins, gate.sensor.first_bin_center)
    return table


def histogram_tables(sensor: SensorModel, frequencies, gate: Gate | None) -> tuple[np.ndarray, np.ndarray | None]:
    """The phases of the bins of a sensor's histograms, and the phase sums of their template, or None.

    Bins in which the template is far above its mean are taken to hold the mean of the others inside the gate, whatever
    they count: a uniform background still adds nothing.

    Returns:
        float32 [n, 2m + 2]; and [2m + 2], or [rows · cols, 2m + 2] if pixels have templates of their own.
    """
    bins = sensor.histograms
    edges = np.arange(sensor.num_bins) + 0.5 if bins is None else bins.centers()
    start, num_bins = (0, sensor.num_bins) if gate is None else (gate.start, gate.num_bins)
    from_start = (edges - start) % sensor.num_bins
    turns = (from_start + sensor.first_bin_center - 0.5)[..., None] * np.asarray((*frequencies, 0)) / num_bins
    phases = np.exp(2j * np.pi * turns) * (from_start < num_bins)[..., None]
    table = phases.astype(np.complex64).view(np.float32)
    if bins is None or bins.template is None:
        return table, None
    of_pixel = bins.template.reshape(-1, bins.num_bins).mean(axis=0)
    left_out = (of_pixel > max(FAR * of_pixel.mean(), 1))[:, None]
    others = (table[:, -2:-1] > 0) & ~left_out
    mean = (table * left_out).sum(axis=0) / max(others.sum(), 1)
    table = ((table + mean) * others).astype(np.float32)
    return table, bins.template @ table
