"""How good a cloud is against a reference, as the RT3D and SRT3D papers count it."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.errors import require


@dataclass(frozen=True)
class Metrics:
    """Detection and depth error of one cloud.

    Args:
        true_detections: share of the reference surfaces with a point within the tolerance.
        false_detections: points farther than the tolerance from every reference of their pixel, over the number of
            reference surfaces; points in pixels without any reference are not judged.
        dae_bins: mean absolute depth error over the matched reference surfaces, bins; NaN if none is matched.
        points: points in the cloud.
    """

    true_detections: float
    false_detections: float
    dae_bins: float
    points: int


def circular_difference(a: np.ndarray, b: np.ndarray, period: float) -> np.ndarray:
    """a − b on a circle, in [−period / 2, period / 2)."""
    return (a - b + period / 2) % period - period / 2


def evaluate(cloud: PointCloud, reference_depth_bins: np.ndarray, tolerance_bins: float, num_bins: int) -> Metrics:
    """Compare a cloud with the true depths.

    Args:
        cloud: the reconstruction.
        reference_depth_bins: float [rows, cols] or [S, rows, cols], NaN = unknown or no surface.
        tolerance_bins: τ; a point within it of a surface of its pixel is a true detection.
        num_bins: T, the period of the depths.
    """
    reference = np.asarray(reference_depth_bins, dtype=np.float64)
    if reference.ndim == 2:
        reference = reference[None]
    require(reference.shape[1:] == cloud.background.shape, "reference shape", reference.shape,
            f"[rows, cols] = {cloud.background.shape}")
    error = np.abs(circular_difference(cloud.depth_bins[None], reference[:, cloud.row, cloud.col], num_bins))
    error = np.where(np.isnan(error), np.inf, error)                                     # [S, N]
    nearest = np.full(reference.shape, np.inf)
    for surface, errors in enumerate(error):
        np.minimum.at(nearest[surface], (cloud.row, cloud.col), errors)
    matched = nearest <= tolerance_bins
    known = np.isfinite(reference)
    judged = known.any(axis=0)[cloud.row, cloud.col]
    false = judged & (error > tolerance_bins).all(axis=0)
    total = max(int(known.sum()), 1)
    return Metrics(float(matched.sum() / total), float(false.sum() / total),
                   float(nearest[matched].mean()) if matched.any() else float("nan"), len(cloud))
