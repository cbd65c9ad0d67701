"""Two sensors that must pass without loss in real time, through real processes; one JSON line each.

    PYTHONPATH=. python benchmarks/gates.py [--seconds 60] [--case gates events] [--out FILE]

gates: 32 × 32 pixels at 150,400 cycles a second, 308 MB/s, as 100 messages of 3 MB a second; two make a frame, so that
50 clouds a second are to come. events: 141 × 141 pixels, 10 photons each, 30 frames a second. Latency counts from the
frame's stamp, where its acquisition begins, to the arrival of the cloud here; `after_frame` leaves the acquisition out.
"""

import argparse
import os
from pathlib import Path

import numpy as np
from live import Pipeline, accounting, percentiles, tell

from srt3d_ros.benchmark.frames import gates_of, gates_sensor, photons_of, sensor_of
from srt3d_ros.core.photons import PhotonGates
from srt3d_ros.processes import join_private_network

CYCLES, DETECTED = 1504, 0.1        # of a message; share of the words that are photons
VARIANTS = 4                        # different messages, sent in turn


def case_of(name: str) -> tuple:
    """Sensor, packets, their rate in Hz and how many make a frame."""
    if name == "gates":
        sensor = gates_sensor()
        packet = gates_of(sensor, DETECTED * CYCLES, CYCLES)
        rolled = [PhotonGates(np.roll(packet.words, k, axis=0)) for k in range(VARIANTS)]
        return sensor, rolled, 100, 2
    sensor = sensor_of(141)
    return sensor, [photons_of(sensor, 10.0)], 30, 1


def measure(name: str, seconds: float) -> dict:
    """Run one case; its figures."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    sensor, packets, rate_hz, per_frame = case_of(name)
    with PipelineProbe(keep_every=10**9) as monitor:
        with Pipeline(monitor, sensor, packets, packets_per_frame=per_frame) as pipeline:
            pipeline.drive(f"{rate_hz}:2")              # compiles for the sensor
            first, load = len(monitor.arrivals), os.getloadavg()[0]
            counted = accounting(monitor)
            said, cpu = pipeline.drive(f"{rate_hz}:{seconds}")
            counted = {key: now - counted.get(key, 0) for key, now in accounting(monitor).items()}
    arrivals = monitor.arrivals[first:]
    sent = said["phases"][0]["sent"]
    latencies_ms = np.array([arrival.latency_ms for arrival in arrivals])
    span_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
    return {"case": name, "seconds": seconds, "packets_sent": sent,
            "packets_skipped": said["phases"][0]["skipped"],
            "MB_per_s": round(said["phases"][0]["bytes"] / seconds / 1e6, 1),
            "clouds": len(arrivals), "clouds_lost": sent // per_frame - len(arrivals),
            "clouds_per_s": round((len(arrivals) - 1) / span_s, 2), "latency_ms": percentiles(latencies_ms),
            "after_frame_ms": percentiles(latencies_ms - 1e3 * per_frame / rate_hz), "cpu_percent": cpu,
            "counted": {key: n for key, n in counted.items() if n}, "load_before": load, "cores": os.cpu_count()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--case", nargs="+", choices=("gates", "events"), default=["gates", "events"])
    parser.add_argument("--out", type=Path, help="append the lines to this file")
    args = parser.parse_args()
    join_private_network()
    for name in args.case:
        tell(measure(name, args.seconds), args.out)


if __name__ == "__main__":
    main()
