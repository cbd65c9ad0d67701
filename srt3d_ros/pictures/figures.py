"""Figures on white, saved as small .png files; and the figure of `srt3d info`."""

import base64
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.files.new_files import file_errors
from srt3d_ros.pictures.colours import BLUE, PHOTON_MAP, VERMILION

DPI = 100
_PALETTE_SIZE = 128
_MOST_STEPS = 1200              # steps in the drawn histogram, about its width in pixels
_GATE_COLOUR = "#f3d9a4"
_IRF_SHOWN = 2e-3               # of its peak; the IRF's tails below it, which may span the period, are not shown


def titled_figure(width_in: float, height_in: float, title: str) -> Figure:
    """An empty figure with a title; $ is not markup."""
    figure = Figure((width_in, height_in), dpi=DPI, layout="constrained")
    figure.suptitle(title, size=13, parse_math=False)
    return figure


def as_image(figure: Figure) -> Image.Image:
    """The figure as an RGB image."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))


def data_uri(image: Image.Image, kind: str, **options: Any) -> str:
    """A picture as a data: URI; `kind` (png, jpeg) and options as for `Image.save`."""
    data = io.BytesIO()
    image.save(data, kind, **options)
    return f"data:image/{kind};base64,{base64.b64encode(data.getvalue()).decode()}"


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure with 128 colours, a quarter of the bytes; InvalidInput if that fails."""
    with file_errors("picture", path):
        as_image(figure).quantize(_PALETTE_SIZE, dither=Image.Dither.NONE).save(path, optimize=True)


def range_axis(axes: Axes, sensor: SensorModel, late_bins: float = 0.0) -> None:
    """Write the ranges above an axis of times of arrival, which come late by this number of bins."""
    axes.secondary_xaxis("top", functions=(lambda toa: sensor.range_m(np.asarray(toa) - late_bins),
                                           lambda range_m: sensor.depth_bins(np.asarray(range_m)) + late_bins)
                         ).set_xlabel("range, m")


def steps(bins: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, int]:
    """At most so many steps of a histogram over consecutive bins: where each begins, their edges, and bins in a step.

    The last step may be narrower.
    """
    width = math.ceil(len(bins) / most)
    starts = np.arange(0, len(bins), width)
    return starts, np.append(bins[starts], bins[-1] + 1) - 0.5, width


def draw_histogram(path: Path, histogram: np.ndarray, counts: np.ndarray, sensor: SensorModel, gate: Gate | None,
                   title: str) -> None:
    """Write a .png with the histogram [T] of all photons and a gate, the counts [rows, cols] of pixels, and the IRF."""
    figure = titled_figure(13, 4.6, title)
    times, pixels, response = figure.subplots(1, 3, width_ratios=(2.4, 1.3, 1))
    starts, edges, _ = steps(np.arange(len(histogram)), _MOST_STEPS)
    heights = np.add.reduceat(histogram, starts) / np.diff(edges)
    times.stairs(heights, edges, fill=True, color=BLUE)
    if gate is not None:
        times.axvspan(gate.first, gate.last, color=_GATE_COLOUR, zorder=0, label=f"gate {gate}")
        times.legend(loc="upper right")
    times.set(xlim=(edges[0], edges[-1]), xlabel="time of arrival, bins", ylabel="photons in a bin, all pixels")
    if (heights > 0).any():
        times.set(yscale="log", ylim=(max(heights[heights > 0].min() / 2, 1e-3), None))
    range_axis(times, sensor)
    image = pixels.imshow(counts, cmap=PHOTON_MAP, interpolation="nearest", vmin=0,
                          vmax=max(float(np.quantile(counts, 0.995)), 1))
    pixels.set(title="photons in a pixel", xlabel="column", ylabel="row")
    figure.colorbar(image, ax=pixels, shrink=0.8, extend="max")
    irf, bins = sensor.mean_irf, sensor.irf_bins
    response.stairs(irf, np.append(bins, bins[-1] + 1) - 0.5, fill=True, color=VERMILION)
    shown = bins[irf > _IRF_SHOWN * irf.max()]
    response.set(title="IRF" if sensor.irf.ndim == 1 else "IRF, mean of all pixels", xlabel="bins from the depth",
                 ylabel="share of the photons", xlim=(shown[0] - 1.5, shown[-1] + 1.5))
    save_png(figure, path)
