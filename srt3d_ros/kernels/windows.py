"""Weights of the windows that neighbouring pixels are pooled over."""

import math
from functools import lru_cache

import numpy as np


@lru_cache
def window_weights(sigma: float) -> np.ndarray:
    """exp(−d² / 2σ²) for d = −⌈2.5 σ⌉ … ⌈2.5 σ⌉: a Gaussian over rows or columns of pixels or cells; float32."""
    radius = math.ceil(2.5 * sigma)
    return np.exp(-np.arange(-radius, radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
