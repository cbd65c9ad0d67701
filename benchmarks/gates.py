"""A SPAD array that must pass without loss in real time, through real processes.

32 × 32 pixels at 150,400 cycles a second, 308 MB/s, as 100 messages of 3 MB a second; two make a frame, so that 50
clouds a second are to come. Latency counts from the frame's stamp, where its acquisition begins, to the arrival of the
cloud here.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.pipeline import percentiles, send
from robustness.testbed import Testbed
from srt3d_ros.benchmark.frames import gates_of, gates_sensor
from srt3d_ros.core.photons import PhotonGates

CYCLES, DETECTED = 1504, 0.1        # of a message; share of the words that are photons
VARIANTS = 4                        # different messages, sent in turn
RATE_HZ, PER_FRAME = 100, 2         # of messages


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60.0, help="(%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    sensor = gates_sensor()
    words = gates_of(sensor, DETECTED * CYCLES, CYCLES).words
    nodes = {"reconstructor": {}, "sketcher": {"packets_per_frame": PER_FRAME}}
    with TemporaryDirectory() as folder, Testbed(nodes, Path(folder) / "gates") as testbed:
        testbed.write_packets("spad", sensor, [PhotonGates(np.roll(words, k, axis=0)) for k in range(VARIANTS)])
        testbed.start("driver")
        send(testbed, "spad", (RATE_HZ, 2))         # compiles for the sensor
        before = testbed.losses()
        (phase,) = send(testbed, "spad", (RATE_HZ, args.seconds))
        lost = testbed.losses() - before
    arrivals = phase.pop("arrivals")
    span_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
    yield {"case": "gates", "seconds": args.seconds, **phase,
           "clouds": len(arrivals), "clouds_lost": phase["sent"] // PER_FRAME - len(arrivals),
           "clouds_per_s": round((len(arrivals) - 1) / span_s, 2),
           "latency_ms": percentiles([arrival.latency_ms for arrival in arrivals]), "lost": dict(lost)}
