"""Expected depth error of a single pixel against the size of its sketch, for each rule that chooses frequencies.

Lines: the bound by which `design` chooses; what the best estimator on the designed sketch, and on all times of arrival,
could reach (Cramér and Rao). Dots: the matched filter's error on simulated photons of pixels with random depths.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, ScalarFormatter
from tqdm import tqdm

from srt3d_ros.core.baselines.toa import DepthInformation
from srt3d_ros.core.frequencies import RULES
from srt3d_ros.core.frequency_design import expected_error_bins
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.weighting import weighted_steps
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

SIZE, NUM_BINS, BIN_WIDTH_S = 100, 1250, 8e-12
IRFS = {"symmetric response": 0.0, "response with a tail": 0.6}             # share of the light in the tail
PHOTONS = ((10.0, 22.0), (0.1, 770.0))                                      # SBR, photons of a pixel
SKETCH_SIZES = (2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 26, 32, 40)
DRAWN = {"consecutive": ("#d55e00", "o", "consecutive"), "spread": ("#0072b2", "^", "spread"),
         "auto": ("#009e73", "s", "designed (auto)")}
MEAN_OF_STD = np.sqrt(2 / np.pi)                                            # mean |error| of a normal one


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--picture", type=Path, default=Path("docs/images/frequencies.png"), help="(%(default)s)")


def run(args: argparse.Namespace) -> tuple:
    """Draw the picture; there are no lines."""
    figure = Figure(figsize=(10, 7.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    with tqdm(total=4 * len(DRAWN) * len(SKETCH_SIZES), unit="point") as progress:
        for row, (sbr, ppp) in enumerate(PHOTONS):
            for col, (name, tail_share) in enumerate(IRFS.items()):
                response = irf.spad(BIN_WIDTH_S, tail_share=tail_share)
                draw(panels[row, col], SensorModel(SIZE, SIZE, NUM_BINS, BIN_WIDTH_S, response), sbr, ppp, progress)
                panels[row, col].set_title(f"{name}, SBR {sbr:g}, {ppp:g} photons", fontsize=11)
    for panel in panels[:, 0]:
        panel.set_ylabel("mean |depth error| of a pixel, bins")
    for panel in panels[1]:
        panel.set_xlabel("m, complex numbers in a sketch")
    panels[0, 1].legend(frameon=False, fontsize=9, loc="upper right")
    figure.savefig(args.picture)
    return ()


def draw(panel, sensor: SensorModel, sbr: float, ppp: float, progress: tqdm) -> None:
    """One response and light level: the bound and the measured error of each rule, over the sizes of the sketch."""
    signal, background = ppp * sbr / (1 + sbr), ppp / (1 + sbr)
    depth = np.random.default_rng(0).uniform(0, NUM_BINS, (SIZE, SIZE))
    frame, truth = Simulator(StaticScene(sensor.range_m(depth)), sensor, sbr=sbr, ppp=ppp, seed=1).frame(0)
    spectrum = np.conj(np.fft.rfft(sensor.irf, NUM_BINS))
    for rule, (colour, marker, label) in DRAWN.items():
        chosen = [RULES[rule](sensor, m) for m in SKETCH_SIZES]
        bound = [expected_error_bins(spectrum, NUM_BINS, k, [signal], [background])[0] for k in chosen]
        panel.plot(SKETCH_SIZES, bound, color=colour, label=f"{label}: bound")
        measured = [measured_error(sensor, k, frame, truth[0], progress) for k in chosen]
        panel.plot(SKETCH_SIZES, measured, marker, color=colour, markersize=5, label=f"{label}: measured")
    best = [MEAN_OF_STD * weighted_steps(sensor, k, "precision").depth_std(signal, ppp) for k in chosen]
    panel.plot(SKETCH_SIZES, best, "--", color=DRAWN["auto"][0], linewidth=1, label="designed: any estimator (CRB)")
    full = MEAN_OF_STD * DepthInformation(sensor).std(signal, background / NUM_BINS)
    panel.axhline(full, color="black", linewidth=1, linestyle=":", label="all times of arrival (CRB)")
    panel.set(xscale="log", yscale="log")
    panel.xaxis.set_major_locator(FixedLocator([2, 3, 5, 10, 20, 40]))
    panel.minorticks_off()
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter(ScalarFormatter())
    panel.grid(color="#d9dce0", linewidth=0.6)


def measured_error(sensor: SensorModel, frequencies, frame, truth: np.ndarray, progress: tqdm) -> float:
    """Mean absolute error of single pixels' matched filters, bins: the highest of a fine grid, then a parabola."""
    seen = Matcher(sensor, frequencies)(sketch_photons(frame, sensor, frequencies))
    cells = 16 * max(frequencies)
    turns = 2 * np.pi * np.outer(frequencies, np.arange(cells)) / cells
    matched = seen.matched.swapaxes(1, 2).reshape(SIZE * SIZE, -1)
    response = matched @ np.concatenate([np.cos(turns), np.sin(turns)]).astype(np.float32)
    top = response.argmax(axis=1)
    before, peak, after = (np.take_along_axis(response, (top + k)[:, None] % cells, 1)[:, 0] for k in (-1, 0, 1))
    shift = 0.5 * (before - after) / np.minimum(before - 2 * peak + after, -1e-6)
    progress.update()
    depth = ((top + shift) * NUM_BINS / cells).reshape(SIZE, SIZE)
    return float(np.abs(circular_difference(depth, truth, NUM_BINS)).mean())
