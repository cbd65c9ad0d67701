"""Latency, losses and processor time of frames through ROS 2 nodes, by frame rate.

Player, sketcher, reconstructor and recorder (`--record`) run in a process each. Each rate is played for some seconds;
the nodes drop what they cannot keep up with, as with a real sensor. tools/watch.py, on the same cores, notes when each
cloud arrives. Latency is from the stamp of the photons to that arrival. `cpu_ms` is each process's time on all cores,
per frame sent, while clouds arrive.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress

import numpy as np
import psutil

from benchmarks.frames import PPP, photons_of, sensor_of
from srt3d_ros.datasets import photon_file
from srt3d_ros.processes.node_command import node_command
from srt3d_ros.processes.private_network import join_private_network
from tools.machines import WAIT_S, Watch, watch_command
from tools.processes import Process, wait

LAST_CLOUD_S = 2.0      # after the player's end: no more clouds will come
SAMPLE_S = 0.1          # between readings of the processes' time


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rates", type=float, nargs="+", default=(10, 20, 30, 40), help="frames per second")
    parser.add_argument("--seconds", type=float, default=5.0, help="playing time of each rate (%(default)g)")
    parser.add_argument("--record", action="store_true", help="run the recorder, too")
    parser.add_argument("--side", type=int, default=141, help="rows and columns (%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    """A line for each rate."""
    join_private_network()
    watch = Watch()
    with tempfile.TemporaryDirectory(prefix="srt3d-ros-") as folder, ExitStack() as started:
        def start(command: list[str], say: Callable[[str], None] = lambda line: None) -> Process:
            process = Process(command, say)
            started.callback(process.stop)
            return process

        photons, sensor = f"{folder}/photons.npz", sensor_of(args.side)
        photon_file.save(photons, sensor, photons_of(sensor, PPP))
        start(watch_command("points"), watch.on_line)
        nodes = {}
        for name in ("reconstructor", "sketcher", "recorder")[:2 + args.record]:
            more = {"path": f"{folder}/clouds.rrd"} if name == "recorder" else {}
            nodes[name] = start(node_command(name, **more))
            wait(lambda: name in watch.reports, name, deadline_s=WAIT_S)
        for rate_hz in (args.rates[0], *args.rates):        # the first round only compiles
            first, sent = len(watch.arrivals), round(rate_hz * args.seconds)
            nodes["player"] = start(node_command("player", input=photons, rate_hz=float(rate_hz), frames=sent))
            spent = _time_of(nodes, lambda: watch.arrivals[first:], rate_hz)
            time.sleep(LAST_CLOUD_S)
            latencies = [arrival.latency_ms for arrival in watch.arrivals[first:]]
            if first and latencies:
                yield {"side": args.side, "ppp": PPP, "rate_hz": rate_hz, "frames": sent, "clouds": len(latencies),
                       "latency_ms": np.round(np.percentile(latencies, [50, 95, 100]), 1).tolist(), "cpu_ms": spent}


def _time_of(nodes: dict[str, Process], arrivals: Callable[[], list], rate_hz: float) -> dict[str, float]:
    """Processor time of the nodes, ms per frame sent, from the first cloud to the player's end."""
    samples, processes = [], {name: psutil.Process(node.pid) for name, node in nodes.items()}
    with suppress(psutil.Error):        # the player has just ended
        while nodes["player"].running:
            if arrivals():
                samples.append((time.monotonic(), {name: sum(one.cpu_times()[:2]) for name, one in processes.items()}))
            time.sleep(SAMPLE_S)
    if len(samples) < 3:
        return {}
    (begin_s, before), (end_s, after) = samples[0], samples[-2]       # the last one may be of a player that ends
    frames = rate_hz * (end_s - begin_s)
    return {name: round(1e3 * (after[name] - before[name]) / frames, 1) for name in before}
