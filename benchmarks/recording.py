"""What a killed recorder loses: it is killed at random moments, and what it has written is repaired and opened.

141 × 141 pixels at 30 Hz through sketcher and reconstructor. `lost_s` is from the last recorded value of any kind that
lacks most to the last cloud that came before the kill.
"""

import argparse
import random
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import trange

from robustness.testbed import Testbed
from srt3d_ros.benchmark.frames import sensor_of
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.repair import repair

SIDE, PPP, RATE_HZ = 141, 15.0, 30.0
VARIANTS = 12                       # different frames, sent in turn: repeated ones would compress too well
WELL_BEGUN = 3_000_000              # bytes of a file that has clouds
TIMEOUT_S = 180.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--kills", type=int, default=20, help="(%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    lost_s, rng, simulator = [], random.Random(1), Simulator(sensor=sensor_of(SIDE), ppp=PPP, seed=1)
    with (TemporaryDirectory() as folder,
          Testbed({"reconstructor": {}, "sketcher": {}}, Path(folder) / "recording") as testbed):
        testbed.write_packets("head", simulator.sensor, [simulator.frame(k)[0] for k in range(VARIANTS)])
        testbed.start("driver")
        testbed.drive(sensor="head", rate_hz=RATE_HZ)
        for kill in trange(args.kills, unit="kill"):
            path = testbed.folder / f"{kill}.rrd"
            recorder = testbed.start("recorder", path=str(path))
            testbed.wait(lambda: path.exists() and path.stat().st_size > WELL_BEGUN, "a recording", TIMEOUT_S)
            testbed.spin(rng.uniform(3, 5))
            killed_ns = time.time_ns()
            recorder.kill()
            copy = repair(path)
            came_ns = max(one.stamp_ns for one in testbed.probe.arrivals if one.received_ns <= killed_ns)
            lost_s.append(max(came_ns - recorded_until_ns(copy), 0) * 1e-9)
            copy.unlink()
            path.unlink()
    yield {"kills": args.kills, "opened": len(lost_s),
           "lost_s": {"median": round(float(np.median(lost_s)), 3), "most": round(max(lost_s), 3)}}


def recorded_until_ns(path: Path) -> float:
    """The newest stamp that clouds and all series of a recording have; −infinity if one of them is empty."""
    reader = RecordingReader(path)
    stamps = [reader.cloud_index().stamp_ns]
    stamps += [one.stamp_ns for name, one in reader.series().items() if name != "drops"]
    return min(float(one.max()) if len(one) else -np.inf for one in stamps)
