"""Draw one pixel: the photons of each bin, what its points make expected, and the difference."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from srt3d_ros.core.expected_photons import expected_at
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.pictures.colours import BLUE, ORANGE, VERMILION
from srt3d_ros.pictures.figures import range_axis, save_png, steps, titled_figure

_MOST_STEPS = 300       # of a histogram: more are not told apart
_FEWEST_STEPS = 60      # around the points of a pixel with fewer photons
_NEAR_WIDTHS = 1.5      # IRFs shown on each side of the points
_IRF_ENDS = 0.01, 0.99      # shares of its photons


def expected_counts(cloud: PointCloud, row: int, col: int) -> np.ndarray:
    """λ(x) = g Σ_k r_k h(x − t_k − δ) + B b(x − δ), photons expected in each bin of a pixel, float64 [T].

    g is the gain; the rest are as in `expected_at`. If N cycles are known, N e^(−Λ(x)/N) (1 − e^(−λ(x)/N)), Λ the sum
    of λ before x: only the first photon of a cycle is recorded. After a dead time of a period or longer, which costs d
    cycles, λ / (1 + d Σλ / N), within 5 %.
    """
    sensor, bins = cloud.sensor, np.arange(cloud.sensor.num_bins)
    signal, background = expected_at(cloud, sensor, np.full(len(bins), row * sensor.cols + col), bins)
    rate = sensor.exposure[row, col] * signal + cloud.background[row, col] / len(bins) * background
    if sensor.cycles and sensor.dead_time.periods:
        rate = rate / (1 + sensor.dead_time.cycles * rate.sum() / sensor.cycles)
    elif sensor.cycles:
        rate = rate / sensor.cycles
        rate = sensor.cycles * np.exp(rate - np.cumsum(rate)) * -np.expm1(-rate)
    return rate


def draw_pixel(path: Path, counts: np.ndarray, cloud: PointCloud, row: int, col: int, title: str,
               labels: Sequence[str]) -> None:
    """Write a .png: counts [T] of a pixel and its fit over all bins (logarithmic) and around its points; residuals.

    Args:
        labels: of the pixel's points.
    """
    sensor, expected = cloud.sensor, expected_counts(cloud, row, col)
    depths = cloud.depth_bins[(cloud.row == row) & (cloud.col == col)] + float(sensor.late[row, col])
    margin = _NEAR_WIDTHS * max(np.diff(np.searchsorted(np.cumsum(sensor.mean_irf), _IRF_ENDS))[0], 4)
    shown = depths if len(depths) else np.array([counts.argmax()])
    around = np.arange(math.floor(shown.min() - margin), math.ceil(shown.max() + margin))
    around = around if len(around) < sensor.num_bins else np.arange(sensor.num_bins)
    figure = titled_figure(13, 6, title)
    panels = figure.subplots(2, 2, sharex="col", height_ratios=(3, 1))
    finest = _MOST_STEPS, min(max(int(counts.sum()), _FEWEST_STEPS), _MOST_STEPS)
    for bins, most, (upper, lower) in zip((np.arange(sensor.num_bins), around), finest, panels.T):
        starts, edges, width = steps(bins, most)
        scale = width / np.diff(edges)
        seen, fitted = (np.add.reduceat(values[bins % sensor.num_bins], starts) for values in (counts, expected))
        upper.stairs(scale * seen, edges, fill=True, color=BLUE, label="photons")
        upper.stairs(scale * fitted, edges, color=ORANGE, linewidth=1.5, label="fit: points and background")
        for depth, label in zip(depths, labels):
            upper.axvline(depth, color=VERMILION, linewidth=1, linestyle="--", label=label)
        lower.stairs(residual(seen, fitted), edges, fill=True, color=BLUE)
        lower.axhline(0, color=ORANGE, linewidth=1)
        lower.set(xlabel="time of arrival, bins", ylabel="residual, σ", xlim=(edges[0], edges[-1]))
        upper.set(ylabel="photons in " + ("a bin" if width == 1 else f"{width} bins"))
        range_axis(upper, sensor, float(sensor.late[row, col]))
    top = max(float(counts.max(initial=0)), float(expected.max(initial=0)), 1)
    panels[0, 0].set(yscale="log", ylim=(max(float(expected[expected > 0].min(initial=top)) / 2, 1e-3 * top), None))
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    save_png(figure, path)


def residual(seen: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Deviance residuals of Poisson counts, ±√(2 (n log(n / λ) − n + λ)): like σ, also for few photons."""
    seen, expected = np.maximum(seen, 0), np.maximum(expected, 1e-9)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.where(seen > 0, seen * np.log(seen / expected), 0)
    return np.sign(seen - expected) * np.sqrt(np.maximum(2 * (logs - seen + expected), 0))
