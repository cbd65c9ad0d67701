"""The intensity of every point: between that of its pool and that of its own pixel."""

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.frame import Frame
from srt3d_ros.core.start import window_weights


def shared_intensity(frame: Frame, state: np.ndarray, own: np.ndarray, kernels) -> np.ndarray:
    """The own intensity counts as far as pixels truly differ.

    With v the variance of the own intensity by photon noise, and s² the mean square of own − pooled around a pixel,
    the pixels themselves differ by τ² = s² − v, and pooled + (own − pooled) · τ² / (τ² + v) has the least error
    (James and Stein's estimator).

    Args:
        frame: the frame.
        state: float32 [rows', K, FIELDS, cols'].
        own: float32 [rows, K, cols], intensities from each pixel alone (`own_intensity`).
        kernels: the device's kernels.

    Returns:
        float32 [rows, K, cols].
    """
    pooled = np.ascontiguousarray(layout.crop(state, *frame.shape)[:, :, layout.INTENSITY])
    excess = (own - pooled) * (pooled > 0)
    exposure = np.maximum(frame.exposure, 1e-6)[:, None]
    background = np.maximum(frame.noise[:, None] - pooled * exposure, 0)
    signal_moment, background_moment = frame.intensity_moments
    variance = (pooled * exposure * signal_moment + background * background_moment) / frame.total_energy**2
    variance = variance / exposure**2 * (pooled > 0)
    weights = window_weights(2.0, 1)
    around, noise = kernels.blur(excess**2, weights, 1), kernels.blur(variance, weights, 1)
    differ = np.maximum(around - noise, 0) / np.maximum(around, 1e-12)
    return np.maximum(pooled + excess * differ, 0.01 * pooled)
