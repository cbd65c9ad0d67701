"""The loop of RT3D and SRT3D: gradient steps on the photons, in turn with a denoiser of the point cloud."""

from collections.abc import Callable

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.progress import progress

ITERATIONS = 25
RATE = 0.25                 # of the full step in depth; against a half, less error wherever photons are few
FAINTEST = 0.01             # of the mean intensity: points below are removed
DEPTHS_PER_PITCH = 6.0      # pixel pitches in depth that smooth like one pixel across


def plug_and_play(step: Callable, depth: np.ndarray, intensity: np.ndarray, exposure: np.ndarray, usual: float,
                  scale_bins: float, num_bins: int) -> tuple[np.ndarray, np.ndarray]:
    """APSS, then 25 times [gradient step, hard threshold on intensity, APSS], and a last step and threshold.

    Args:
        step: called with depth and intensity, which it changes in place.
        depth, intensity: the start, float32 [rows, K, cols]; intensity 0 = no point.
        exposure: float32 [rows, cols], 0 where no point may be.
        usual: of `usual_intensity`.
        scale_bins: bins that count as one pixel, see `depth_scale_bins`.
    """
    apss = kernels_for("cpu")[1].apss
    depth, intensity, normal = apss(depth, intensity, None, exposure, scale_bins, num_bins)
    for iteration in progress(range(ITERATIONS + 1), "reconstructing"):
        step(depth, intensity)
        intensity[intensity < FAINTEST * usual] = 0
        if iteration < ITERATIONS:
            depth, intensity, normal = apss(depth, intensity, normal, exposure, scale_bins, num_bins)
    return depth, intensity


def usual_intensity(intensity: np.ndarray, exposure: np.ndarray) -> float:
    """Mean intensity of the strongest points of the pixels in use."""
    used = exposure > 0
    return float(intensity.max(axis=1)[used].mean()) if used.any() else 0.0


def depth_scale_bins(sensor: SensorModel, depth: np.ndarray, intensity: np.ndarray, peak_bins: float) -> float:
    """Bins of depth that count as one pixel: six times the distance of neighbouring rays at the scene.

    That is what RT3D's authors use. Limited to half to twice the width of a return's peak: closer depths cannot be told
    apart, and over more, surfaces would merge where the field of view is not known.

    Args:
        depth, intensity: the start, [rows, K, cols].
        peak_bins: width of the matched filter's peak.
    """
    rays = sensor.rays
    gaps = [np.linalg.norm(np.diff(rays, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    gap = np.median(np.concatenate(gaps)) if rays.size > 3 else 0.0
    seen = depth[intensity > 0]
    scene_m = abs(float(sensor.range_m(np.median(seen)))) if len(seen) else 0.0
    return float(np.clip(DEPTHS_PER_PITCH * gap * scene_m / sensor.bin_width_m, peak_bins / 2, peak_bins * 2))
