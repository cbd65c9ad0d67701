"""Two sensors that must pass without loss in real time, through real processes; one line each.

gates: 32 × 32 pixels at 150,400 cycles a second, 308 MB/s, as 100 messages of 3 MB a second; two make a frame, so that
50 clouds a second are to come. events: 141 × 141 pixels, 10 photons each, 30 frames a second. Latency counts from the
frame's stamp, where its acquisition begins, to the arrival of the cloud here; `after_frame` leaves the acquisition out.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.pipeline import driven_pipeline, losses, percentiles, write_photons
from srt3d_ros.benchmark.frames import gates_of, gates_sensor, photons_of, sensor_of
from srt3d_ros.core.photons import PhotonGates

CASES = ("gates", "events")
CYCLES, DETECTED = 1504, 0.1        # of a message; share of the words that are photons
VARIANTS = 4                        # different messages, sent in turn


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--case", nargs="+", choices=CASES, default=CASES)


def run(args: argparse.Namespace) -> Iterator[dict]:
    for name in args.case:
        yield {"case": name, "seconds": args.seconds, **measure(*packets_of(name), args.seconds)}


def packets_of(name: str) -> tuple:
    """Sensor, packets, their rate in Hz and how many make a frame."""
    if name == "gates":
        sensor = gates_sensor()
        packet = gates_of(sensor, DETECTED * CYCLES, CYCLES)
        return sensor, [PhotonGates(np.roll(packet.words, k, axis=0)) for k in range(VARIANTS)], 100, 2
    sensor = sensor_of(141)
    return sensor, [photons_of(sensor, 10.0)], 30, 1


def measure(sensor, packets, rate_hz: int, per_frame: int, seconds: float) -> dict:
    """The figures of one case."""
    nodes = {"reconstructor": {}, "sketcher": {"packets_per_frame": per_frame}}
    with driven_pipeline(nodes, lambda folder: write_photons(folder, sensor, packets)) as pipeline:
        pipeline.drive(f"{rate_hz}:2")              # compiles for the sensor
        first, before = len(pipeline.probe.arrivals), losses(pipeline.probe)
        (sent,), cpu = pipeline.drive(f"{rate_hz}:{seconds}")
        arrivals, after = pipeline.probe.arrivals[first:], losses(pipeline.probe)
    latencies_ms = np.array([arrival.latency_ms for arrival in arrivals])
    span_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
    return {"packets_sent": sent["sent"], "packets_skipped": sent["skipped"],
            "MB_per_s": round(sent["bytes"] / seconds / 1e6, 1),
            "clouds": len(arrivals), "clouds_lost": sent["sent"] // per_frame - len(arrivals),
            "clouds_per_s": round((len(arrivals) - 1) / span_s, 2), "latency_ms": percentiles(latencies_ms),
            "after_frame_ms": percentiles(latencies_ms - 1e3 * per_frame / rate_hz), "cpu_percent": cpu,
            "counted": {key: n - before.get(key, 0) for key, n in after.items() if n != before.get(key, 0)}}
