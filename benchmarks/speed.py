"""Speed and memory of sketching and reconstruction, on simulated 141 × 141 frames.

    python benchmarks/speed.py [--repeats 7] [--out benchmarks/results/NAME.jsonl]

Prints a table, and one line of JSON for each measurement into --out. Absolute times depend on what else the machine
does: the load average is part of every line, and the times for different photon counts are taken in turns.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.core.srt3d import SRT3D
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.evaluation.machine import machine

PPP = (1, 10, 100, 1000)
SBR = 1.0
SKETCH_SIZE = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--out", type=Path, help="append a line of JSON for each measurement to this file")
    args = parser.parse_args()

    simulators = {ppp: Simulator(ppp=ppp, sbr=SBR, seed=1) for ppp in PPP}
    sensor = simulators[PPP[0]].sensor
    frequencies = choose("auto", sensor, SKETCH_SIZE)
    frames = {ppp: simulator.frame(0)[0] for ppp, simulator in simulators.items()}
    srt3d = SRT3D(sensor, frequencies)
    srt3d.warm_up()
    sketchers = {ppp: Sketcher(sensor, frequencies) for ppp in PPP}
    sketches = {}
    for ppp, sketcher in sketchers.items():
        sketcher.add(frames[ppp])
        sketches[ppp] = sketcher.sketch()

    sketch_s, reconstruct_s = ({ppp: [] for ppp in PPP} for _ in range(2))
    for _ in tqdm(range(args.repeats), unit="round"):
        for ppp in PPP:
            frame = PhotonEvents(frames[ppp].pixel, frames[ppp].toa)       # anew: whether it is sorted is not known yet
            sketchers[ppp].reset()
            sketch_s[ppp].append(seconds(lambda: sketchers[ppp].add(frame)))
            reconstruct_s[ppp].append(seconds(lambda: srt3d(sketches[ppp])))

    lines = []
    for ppp in PPP:
        common = {"ppp": ppp, "sbr": SBR, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
                  "sketch_size": SKETCH_SIZE, "photons": frames[ppp].photons}
        photons_per_s = [frames[ppp].photons / s for s in sketch_s[ppp]]
        lines.append({"what": "sketch, sorted photons", **common, "photons_per_s": spread(photons_per_s, 0),
                      "ms": spread([1e3 * s for s in sketch_s[ppp]], 2), "sketcher_bytes": size(sketchers[ppp])})
        lines.append({"what": "reconstruct", **common, "ms": spread([1e3 * s for s in reconstruct_s[ppp]], 2)})
    for line in lines:
        line.update(machine())
    print(table(lines))
    if args.out:
        with open(args.out, "a") as file:
            file.writelines(json.dumps(line) + "\n" for line in lines)


def seconds(work) -> float:
    """How long work() takes."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def spread(values: list[float], digits: int) -> dict:
    """min, median and max."""
    return {name: round(float(f(values)), digits) for name, f in (("min", min), ("median", np.median), ("max", max))}


def size(sketcher: Sketcher) -> int:
    """Bytes of all arrays that a Sketcher keeps."""
    return sum(value.nbytes for value in vars(sketcher).values() if isinstance(value, (np.ndarray, torch.Tensor)))


def table(lines: list[dict]) -> str:
    """For people."""
    rows = [f"{'':<24}{'ppp':>6}{'ms: min':>10}{'median':>8}{'max':>8}   photons/s, median   sketcher, MB"]
    for line in lines:
        ms = line["ms"]
        row = f"{line['what']:<24}{line['ppp']:>6}{ms['min']:>10.1f}{ms['median']:>8.1f}{ms['max']:>8.1f}"
        if "photons_per_s" in line:
            row += f"{line['photons_per_s']['median']:>20.3g}{line['sketcher_bytes'] / 1e6:>15.1f}"
        rows.append(row)
    return "\n".join(rows)


if __name__ == "__main__":
    main()
