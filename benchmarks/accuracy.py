"""True and false detections and depth error against photons per pixel, by method.

The simulated head, 141 × 141 pixels, m = 10, all methods on the same photons. A line has the true and false detections
(TD, FD; %) within 40 mm and the depth error (DAE, mm), as docs/evaluation.md defines them.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from benchmarks.figure1 import write_table
from benchmarks.frames import PPPS, SKETCH_SIZE
from srt3d_ros.core.methods import METHODS
from srt3d_ros.evaluation import run as evaluation
from srt3d_ros.evaluation.cases import simulated
from srt3d_ros.evaluation.scores import averaged
from srt3d_ros.pictures.curves import draw_metrics


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ppp", type=float, nargs="+", default=PPPS, help="photons per pixel")
    parser.add_argument("--sbr", type=float, default=1.0, help="signal over background (%(default)g)")
    parser.add_argument("--repeats", type=int, default=1, help="draws of the photons (%(default)d)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="picture to draw; a table (.md) goes beside it")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each number of photons and method."""
    jobs = evaluation.jobs_for(simulated("bust", [args.sbr], args.ppp, args.repeats), METHODS.values(), [SKETCH_SIZE])
    with tqdm(total=len(jobs), unit="cloud") as bar:
        rows = averaged([outcome.row for outcome in evaluation.run(jobs, [], bar)])
    lines = [{"method": row["method"], "sbr": row["sbr"], "ppp": row["ppp"],
              "td_percent": round(row["true_detections_percent"], 2),
              "fd_percent": round(row["false_detections_percent"], 2), "dae_mm": round(row["dae_mm"], 3)}
             for row in rows]
    if args.picture:
        draw_metrics(args.picture, rows, "Simulated head, 141 × 141 pixels", list(METHODS))
        write_table(args.picture, lines, "TD % / FD % / DAE mm",
                    "{td_percent:.1f} / {fd_percent:.1f} / {dae_mm:.2f}")
    yield from lines
