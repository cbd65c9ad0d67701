"""A SPAD array that must pass without loss in real time, through real processes.

32 × 32 pixels at 150,400 cycles a second, 308 MB/s, as 100 messages of 3 MB a second; two make a frame, so that 50
clouds a second are to come. Latency counts from the frame's stamp, where its acquisition begins, to the arrival of the
cloud here; `after_frame` leaves the acquisition out.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.pipeline import driven_pipeline, losses, percentiles, write_photons
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
    packets = [PhotonGates(np.roll(words, k, axis=0)) for k in range(VARIANTS)]
    nodes = {"reconstructor": {}, "sketcher": {"packets_per_frame": PER_FRAME}}
    with driven_pipeline(nodes, lambda folder: write_photons(folder, sensor, packets)) as pipeline:
        pipeline.drive(f"{RATE_HZ}:2")              # compiles for the sensor
        first, before = len(pipeline.probe.arrivals), losses(pipeline.probe)
        (sent,), cpu = pipeline.drive(f"{RATE_HZ}:{args.seconds}")
        arrivals, after = pipeline.probe.arrivals[first:], losses(pipeline.probe)
    latencies_ms = np.array([arrival.latency_ms for arrival in arrivals])
    span_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
    yield {"case": "gates", "seconds": args.seconds, "packets_sent": sent["sent"], "packets_skipped": sent["skipped"],
           "MB_per_s": round(sent["bytes"] / args.seconds / 1e6, 1),
           "clouds": len(arrivals), "clouds_lost": sent["sent"] // PER_FRAME - len(arrivals),
           "clouds_per_s": round((len(arrivals) - 1) / span_s, 2), "latency_ms": percentiles(latencies_ms),
           "after_frame_ms": percentiles(latencies_ms - 1e3 * PER_FRAME / RATE_HZ), "cpu_percent": cpu,
           "counted": {key: n - before.get(key, 0) for key, n in after.items() if n != before.get(key, 0)}}
