"""`histograms` through a player and a sketcher: what arrives, how late it is sketched, and what of a core each takes.

Counts are uint16. What a frame costs does not depend on them. """

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.pipeline import cpu_s
from robustness.testbed import Testbed
from srt3d_ros.benchmark.frames import photons_of
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.datasets import npz
from srt3d_ros.datasets.scene import default_sensor
from srt3d_ros.nodes.pipeline_probe import PipelineProbe

SIZES = {"141x141x4613": 10.0, "32x48x64": 60.0}        # with the rate in Hz that is the goal
PPP = 10.0
SETTLE_S, START_S = 10.0, 60.0
TOTALS = ("frames_out", "dropped", "message_lost")
NODES = ("player", "sketcher")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sizes", nargs="+", default=list(SIZES), metavar="ROWSxCOLSxBINS", help="(%(default)s)")
    parser.add_argument("--rate-hz", type=float, help="frames a second (10 and 60)")
    parser.add_argument("--seconds", type=float, default=20.0, help="that are counted (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    for size in args.sizes:
        yield measure(*map(int, size.split("x")), args.rate_hz or SIZES[size], args.seconds)


def measure(rows: int, cols: int, bins: int, rate_hz: float, seconds: float) -> dict:
    """The figures of one size at one rate, after SETTLE_S."""
    scene = default_sensor()
    share = bins / scene.num_bins
    irf = scene.irf if share == 1 else np.array([1, 2, 1], np.float32)
    sensor = scene.replace(rows=rows, cols=cols, projection=Pinhole.from_fov(rows, cols, 11.0), num_bins=bins, irf=irf,
                           irf_ref=int(irf.argmax()), bin_width_s=scene.bin_width_s / share,
                           toa_offset_bins=scene.toa_offset_bins * share)
    with TemporaryDirectory() as folder, Testbed({"sketcher": {}}, Path(folder) / "histograms") as testbed:
        path = testbed.folder / "frame.npz"
        npz.save(path, sensor, photons_of(sensor, PPP))
        testbed.start("player", input=path, output="histograms", rate_hz=rate_hz)
        probe = testbed.probe
        testbed.wait(lambda: probe.total("sketcher", "frames_out"), "a sketch", START_S)
        testbed.spin(SETTLE_S)
        before, used_s = _totals(probe), [cpu_s(testbed[name].pid) for name in NODES]
        testbed.spin(seconds)
        used_s = [cpu_s(testbed[name].pid) - used for name, used in zip(NODES, used_s)]
        done = _totals(probe)
        done.subtract(before)
        return {"size": f"{rows}x{cols}x{bins}", "MB": round(2e-6 * rows * cols * bins, 2), "rate_hz": rate_hz,
                "sent_per_s": round(done["sent"] / seconds, 2),
                "sketches_per_s": round(done["frames_out"] / seconds, 2),
                "lost": done["message_lost"], "dropped": done["dropped"],
                "latency_ms": {p: float(probe.value("sketcher", f"latency_{p}_ms")) for p in ("p50", "p95")},
                "cpu_percent": {name: round(100 * used / seconds, 1) for name, used in zip(NODES, used_s)}}


def _totals(probe: PipelineProbe) -> Counter:
    sent = {"sent": probe.total("player", "frames_out")}
    return Counter(sent | {name: probe.total("sketcher", name) for name in TOTALS})
