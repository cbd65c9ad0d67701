"""The picture of `srt3d info`: histograms of photons over time and pixels, and the IRF."""

import math
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.pictures.colours import BLUE, PHOTON_MAP, VERMILION
from srt3d_ros.pictures.figures import save_png, titled_figure

_MOST_STEPS = 1200              # steps in the drawn histogram, about its width in pixels
_PHOTON_COLOUR, _GATE_COLOUR, _IRF_COLOUR = BLUE, "#f3d9a4", VERMILION
_IRF_SHOWN = 2e-3                # of its peak; the IRF's tails below it, which may span the period, are not shown


def draw_histogram(path: Path, histogram: np.ndarray, counts: np.ndarray, sensor: SensorModel, gate: Gate | None,
                   title: str) -> None:
    """Write a .png with the histogram [T] of all photons and a gate, the counts [rows, cols] of pixels, and the IRF."""
    figure = titled_figure(13, 4.6, title)
    times, pixels, response = figure.subplots(1, 3, width_ratios=(2.4, 1.3, 1))
    width = math.ceil(len(histogram) / _MOST_STEPS)       # bins in a step
    starts = np.arange(0, len(histogram), width)
    heights = np.add.reduceat(histogram, starts) / np.diff(starts, append=len(histogram))
    edges = np.append(starts, len(histogram)) - 0.5
    times.stairs(heights, edges, fill=True, color=_PHOTON_COLOUR)
    if gate is not None:
        times.axvspan(gate.first, gate.last, color=_GATE_COLOUR, zorder=0, label=f"gate {gate}")
        times.legend(loc="upper right")
    times.set(xlim=(edges[0], edges[-1]), xlabel="time of arrival, bins", ylabel="photons in a bin, all pixels")
    if (heights > 0).any():
        times.set(yscale="log", ylim=(max(heights[heights > 0].min() / 2, 1e-3), None))
    times.secondary_xaxis("top", functions=(sensor.range_m, sensor.depth_bins)).set_xlabel("range, m")
    image = pixels.imshow(counts, cmap=PHOTON_MAP, interpolation="nearest", vmin=0,
                          vmax=max(float(np.quantile(counts, 0.995)), 1))
    pixels.set(title="photons in a pixel", xlabel="column", ylabel="row")
    figure.colorbar(image, ax=pixels, shrink=0.8, extend="max")
    irf = sensor.mean_irf
    response.stairs(irf, np.arange(len(irf) + 1) - sensor.irf_ref - 0.5, fill=True, color=_IRF_COLOUR)
    shown = np.flatnonzero(irf > _IRF_SHOWN * irf.max())
    response.set_xlim(shown[0] - sensor.irf_ref - 1.5, shown[-1] - sensor.irf_ref + 1.5)
    response.set(title="IRF" if sensor.irf.ndim == 1 else "IRF, mean of all pixels", xlabel="bins from the depth",
                 ylabel="share of the photons")
    save_png(figure, path)
