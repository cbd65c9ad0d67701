"""Compares clouds with a reference as the papers on RT3D and SRT3D do (equations: docs/evaluation.md)."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.errors import require

NAN = float("nan")


@dataclass(frozen=True)
class Metrics:
    """Figures of merit of one cloud; NaN where there is nothing to compare.

    Args:
        true_detections: share of the reference surfaces with a point within the tolerance.
        false_detections: points farther than the tolerance from every reference of their pixel, over the number of
            reference surfaces; points in pixels without a reference count only if the reference is complete.
        dae_bins: mean absolute depth error over the matched reference surfaces, bins (DAE).
        points: points in the cloud.
        by_surface: true_detections of each reference surface alone.
        iae: normalised intensity absolute error (IAE): the sum of abs(r − r̂) of matched references, r of missed ones,
            and r̂ of points that match none, divided by Σ r over all references.
        within_1_std, within_2_std: share of the judged points whose error from the nearest reference of their pixel is
            at most 1 or 2 times their own `depth_std_bins`.
    """

    true_detections: float
    false_detections: float
    dae_bins: float
    points: int
    by_surface: tuple[float, ...] = ()
    iae: float = NAN
    within_1_std: float = NAN
    within_2_std: float = NAN


def circular_difference(a: np.ndarray, b: np.ndarray, period: float) -> np.ndarray:
    """a − b on a circle, in [−period / 2, period / 2)."""
    return (a - b + period / 2) % period - period / 2


def evaluate(cloud: PointCloud, reference_depth_bins: np.ndarray, tolerance_bins: float, num_bins: int,
             reference_intensity: np.ndarray | None = None, complete: bool = False) -> Metrics:
    """Compare a cloud with the truth.

    Args:
        cloud: the reconstruction.
        reference_depth_bins: float [rows, cols] or [S, rows, cols], NaN = unknown or no surface.
        tolerance_bins: τ; a point within it of a surface of its pixel is a true detection.
        num_bins: T, the period of the depths.
        reference_intensity: the same shape, expected signal photons; gives `iae`.
        complete: pixels without a reference see no surface, as in a simulation: points there are false.
    """
    reference = _as_surfaces("reference shape", reference_depth_bins, cloud)
    known = np.isfinite(reference)
    of_known = np.any(known, axis=0)[cloud.row, cloud.col]          # points in pixels with references
    judged = np.ones(len(cloud), bool) if complete else of_known
    error = np.abs(circular_difference(cloud.depth_bins[None], reference[:, cloud.row, cloud.col], num_bins))
    error = np.where(np.isnan(error), np.inf, error)            # of each point from each reference of its pixel, [S, N]
    nearest, point = _nearest(cloud, reference.shape, error)
    matched, near = known & (nearest <= tolerance_bins), error <= tolerance_bins
    total = max(int(known.sum()), 1)
    false = judged & ~near.any(axis=0)
    scaled = of_known & (cloud.depth_std_bins > 0)
    stds = error.min(axis=0)[scaled] / cloud.depth_std_bins[scaled]
    return Metrics(
        float(matched.sum() / total), float(false.sum() / total), _mean(nearest[matched]), len(cloud),
        tuple(float(found.sum() / max(int(every.sum()), 1)) for found, every in zip(matched, known)),
        NAN if reference_intensity is None else
        _intensity_error(cloud, reference_intensity, known, matched, point, near, judged),
        _mean(stds <= 1), _mean(stds <= 2))


def _nearest(cloud: PointCloud, shape: tuple[int, int, int], error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least error of each reference, [S, rows, cols], ∞ if none, and the index of its point."""
    nearest, point = np.full(shape, np.inf), np.full(shape, -1)
    for surface, errors in enumerate(error):
        order = np.argsort(-errors, kind="stable")          # the nearest is written last
        order = order[np.isfinite(errors[order])]
        nearest[surface, cloud.row[order], cloud.col[order]] = errors[order]
        point[surface, cloud.row[order], cloud.col[order]] = order
    return nearest, point


def _intensity_error(cloud: PointCloud, reference_intensity: np.ndarray, counts: np.ndarray, matched: np.ndarray,
                     point: np.ndarray, near: np.ndarray, judged: np.ndarray) -> float:
    """Metrics.iae.

    Args:
        counts, matched, point: [S, rows, cols], whether a reference counts, whether it has a point within the
            tolerance, and the index of its nearest point.
        near: [S, N], whether a point lies within the tolerance of a reference.
        judged: [N], whether the truth in the point's pixel is known.
    """
    intensity = _as_surfaces("intensity shape", reference_intensity, cloud)
    require(intensity.shape == counts.shape, "intensity shape", intensity.shape, f"{counts.shape}")
    counts = counts & np.isfinite(intensity)
    total = intensity[counts].sum()
    if total <= 0:
        return NAN
    matched, missed = matched & counts, counts & ~matched
    apart = np.abs(intensity[matched] - cloud.intensity[point[matched]]).sum()
    used = np.zeros(len(cloud), bool)
    used[point[matched]] = True
    excused = (near & ~counts[:, cloud.row, cloud.col]).any(axis=0)         # near a reference that does not count
    surplus = judged & ~used & ~excused
    return float((apart + intensity[missed].sum() + cloud.intensity[surplus].sum()) / total)


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else NAN


def _as_surfaces(field: str, values: np.ndarray, cloud: PointCloud) -> np.ndarray:
    values = np.array(values, np.float64, ndmin=3)
    require(values.shape[1:] == cloud.background.shape, field, values.shape,
            f"[rows, cols] = {cloud.background.shape}")
    return values
