"""Which frequencies a sketch keeps."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequency_design import design
from srt3d_ros.core.sketching.sketch import MAX_SKETCH_SIZE, check_frequencies
from srt3d_ros.errors import InvalidInput, require

DEFAULT_SKETCH_SIZE = 10


def angular_frequencies(frequencies, num_bins: int) -> np.ndarray:
    """ω_l = 2π k_l / T in radians per bin, float64 [m]."""
    return 2 * np.pi * np.asarray(frequencies, dtype=np.float64) / num_bins


def irf_spectrum(sensor: SensorModel, frequencies) -> np.ndarray:
    """ĥ(ω_l) = Σ_b irf[b] exp(i ω_l (b − irf_ref)), complex128 [m], or [pixels, m] if the sensor has an IRF per pixel.

    A return at depth d has the expected sketch ĥ(ω) exp(i ω d).
    """
    bins = np.arange(sensor.irf.shape[-1]) - sensor.irf_ref
    phases = np.exp(1j * np.outer(bins, angular_frequencies(frequencies, sensor.num_bins)))
    return sensor.irf.astype(np.float64) @ phases


def consecutive(sketch_size: int) -> tuple[int, ...]:
    """1 … m, as in the paper's experiments."""
    return tuple(range(1, sketch_size + 1))


RULES = {"auto": design, "consecutive": lambda _, sketch_size: consecutive(sketch_size)}


def choose(spec: str, sensor: SensorModel, sketch_size: int | None = None) -> tuple[int, ...]:
    """Frequencies from what a user writes.

    Args:
        spec: "auto" (the least expected error, see `design`), "consecutive", or a list such as "1,2,5".
        sensor: gives T and the IRF.
        sketch_size: m; DEFAULT_SKETCH_SIZE unless given. With a list it must be the list's length, or None.

    Raises:
        InvalidInput: if m is too large for T, or the list has a frequency that means nothing.
    """
    if spec in RULES:
        most = max(min((sensor.num_bins - 1) // 2, MAX_SKETCH_SIZE), 1)
        m = min(DEFAULT_SKETCH_SIZE, most) if sketch_size is None else sketch_size
        require(1 <= m <= most, "sketch_size", m, f"1 to {most} for T = {sensor.num_bins} bins")
        return check_frequencies(RULES[spec](sensor, m), sensor.num_bins)
    try:
        listed = [int(part) for part in spec.split(",")]
    except ValueError:
        raise InvalidInput("frequencies", spec, "auto, consecutive, or a list of integers such as 1,2,5") from None
    require(sketch_size in (None, len(listed)), "sketch_size", sketch_size,
            f"{len(listed)}, the number of frequencies listed (or leave it out)")
    return check_frequencies(listed, sensor.num_bins)
