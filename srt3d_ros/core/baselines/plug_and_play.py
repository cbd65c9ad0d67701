"""The loop of RT3D and SRT3D: gradient steps on the photons alternate with a denoiser of the point cloud."""

from collections.abc import Callable

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import APSS_ENOUGH
from srt3d_ros.kernels.contract import Array, Kernels
from srt3d_ros.progress import progress

ITERATIONS = 25
RATE = 0.25                 # share of the full step in depth; a half has more error where photons are few
FAINTEST = 0.01             # of the mean intensity: weaker points are removed
DEPTHS_PER_PITCH = 6.0      # pixel pitches of depth that count as one pixel across


def plug_and_play(kernels: Kernels, step: Callable, depth: Array, intensity: Array, enough: Array, scale_bins: float,
                  num_bins: int) -> tuple[Array, Array]:
    """APSS, then 25 times [step, APSS], and a last step.

    Args:
        step: from depth and intensity to those after a gradient step and the hard threshold FAINTEST.
        depth, intensity: the start, float32 [rows', K, cols']; intensity 0 = no point.
        enough: of `points_needed`.
        scale_bins: bins of depth that count as one pixel, from `depth_scale_bins`.
    """
    depth, intensity, normal = kernels.apss(depth, intensity, None, enough, scale_bins, num_bins)
    for iteration in progress(range(ITERATIONS + 1), "reconstructing"):
        depth, intensity = step(depth, intensity)
        if iteration < ITERATIONS:
            depth, intensity, normal = kernels.apss(depth, intensity, normal, enough, scale_bins, num_bins)
    return depth, intensity


def points_needed(exposure: np.ndarray) -> np.ndarray:
    """Points that make a surface in each pixel, float32 [rows', cols']; 0 where exposure, [rows, cols], is 0.

    APSS_ENOUGH, or as many as there are pixels of the 3 × 3 in the image.
    """
    high, wide = (1 + (at > 0) + (at < len(at) - 1) for at in map(np.arange, exposure.shape))
    return maps.pad(np.minimum(high[:, None] * wide, APSS_ENOUGH) * (exposure > 0))


def depth_scale_bins(sensor: SensorModel, median_depth: Array, peak_bins: float) -> Array:
    """Bins of depth that count as one pixel: six times the distance of neighbouring rays at the scene, as in RT3D.

    Limited to half to twice the width of a return's peak: closer depths cannot be resolved, and a larger scale merges
    surfaces where the field of view is not known.

    Args:
        median_depth: of the scene, bins: a number, perhaps on a device.
        peak_bins: width of the matched filter's peak.
    """
    rays = sensor.rays
    gaps = [np.linalg.norm(np.diff(rays, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    gap = np.median(np.concatenate(gaps)) if rays.size > 3 else np.float32(0)
    scene_m = abs(float(sensor.range_m(0)) + median_depth * sensor.bin_width_m)
    return (scene_m * (DEPTHS_PER_PITCH * gap) / sensor.bin_width_m).clip(peak_bins / 2, peak_bins * 2)
