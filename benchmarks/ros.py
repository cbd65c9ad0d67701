"""Latency and losses of frames through ROS 2 nodes, by frame rate.

Player, sketcher and reconstructor run in a process each. Each rate is played for some seconds; the nodes drop what they
cannot keep up with, as with a real sensor. tools/watch.py, on the same cores, notes when each cloud arrives. Latency is
from the stamp of the photons to that arrival.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.frames import PPP, save_frame
from srt3d_ros.processes.node_command import node_command
from srt3d_ros.processes.private_network import join_private_network
from tools.machines import WAIT_S, Watch, watch_command
from tools.processes import Process, wait

LAST_CLOUD_S = 2.0      # after the player's end: no more clouds will come


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rates", type=float, nargs="+", default=(10, 20, 30, 40), help="frames per second")
    parser.add_argument("--seconds", type=float, default=5.0, help="playing time of each rate (%(default)g)")
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

        photons = save_frame(Path(folder), args.side)
        start(watch_command("points"), watch.on_line)
        for name in ("reconstructor", "sketcher"):
            start(node_command(name))
            wait(lambda: name in watch.reports, name, deadline_s=WAIT_S)
        for rate_hz in (args.rates[0], *args.rates):        # the first round only compiles
            first, sent = len(watch.arrivals), round(rate_hz * args.seconds)
            start(node_command("player", input=photons, rate_hz=float(rate_hz), frames=sent)).code()
            time.sleep(LAST_CLOUD_S)
            latencies = [arrival.latency_ms for arrival in watch.arrivals[first:]]
            if first and latencies:
                yield {"side": args.side, "ppp": PPP, "rate_hz": rate_hz, "frames": sent, "clouds": len(latencies),
                       "latency_ms": np.round(np.percentile(latencies, [50, 95, 100]), 1).tolist()}
