"""Run the pipeline for half an hour: does it grow, leak, slow down or lose anything?

The simulator's moving head at 10 Hz, 141 × 141 pixels, 15 photons per pixel, goes through player, sketcher,
reconstructor and recorder, each a process with its default parameters. The recorder begins a new file every five
minutes or so: until a file is finished rerun keeps its index in memory. After a warm-up of three minutes, at most a
fifth of the run, the last minute is compared with the first, and of memory the peak during one file:

    memory      resident, of no process more than 3 % more
    files, threads, /dev/shm    no more than at any time until the end of the first minute
    latency     from the stamp to the cloud's arrival, 95 % of the clouds: within 10 %
    frames      sent = reconstructed = recorded: none lost, as the nodes count and as the recordings hold
"""

import argparse
import re
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import psutil
from tqdm import tqdm

from robustness.testbed import Testbed
from srt3d_ros.recording.reader import RecordingReader

LISTENERS = ("recorder", "reconstructor", "sketcher")       # started before the player
SCENE = {"ppp": 15.0, "sbr": 1.0}
RATE_HZ, LATENCY_PERCENT = 10.0, 10.0
CLOUDS_S = 60.0             # for the first cloud to come, and for the last
MIN_SPLIT_S = 300.0
ZERO = ("dropped", "message_lost", "errors", "recording_dropped", "unaccounted_frames", "unaccounted_photons")
MB = 1e6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=1800.0, help="default: %(default)g")
    parser.add_argument("--input", default="simulator", help="photon file instead of the simulated head")
    parser.add_argument("--growth-percent", type=float, default=3.0, help="allowed of the memory; default: %(default)g")
    parser.add_argument("--lossless", action="store_true", help="let frames wait while a busy machine stalls")


def run(args: argparse.Namespace) -> tuple[list, dict]:
    folder = args.out.parent / "soak"
    begin_s, end_s = min(180.0, args.seconds / 5), args.seconds - 1
    minute_s = min(60.0, (args.seconds - begin_s) / 3)
    apart_s = end_s - minute_s - begin_s        # whole files, so that the last minute sees one at the age of the first
    file_s = apart_s / max(apart_s // MIN_SPLIT_S, 1)
    every = {"lossless": True} if args.lossless else {}
    nodes = dict.fromkeys(LISTENERS, every)
    nodes["recorder"] = every | {"path": str(folder / "soak.rrd"), "split_period_s": file_s}
    frames = round(args.seconds * RATE_HZ)
    with Testbed(nodes, folder) as testbed:
        probe = testbed.probe
        testbed.start("player", input=args.input, rate_hz=RATE_HZ, frames=frames, seed=args.seed, **SCENE, **every)
        testbed.wait(lambda: probe.arrivals, "a cloud", CLOUDS_S)
        began_ns = time.time_ns()
        held = _sample(testbed, args.seconds)
        testbed.saw(lambda: len(probe.arrivals) >= frames and testbed.ended("player"), CLOUDS_S)
        ended = testbed.failed()
        testbed.settle(LISTENERS)
    arrived_s = np.array([(one.received_ns - began_ns) * 1e-9 for one in probe.arrivals])
    minutes = (begin_s, begin_s + minute_s), (end_s - minute_s, end_s)
    in_file = min(file_s, (end_s - begin_s) / 2)
    files = (begin_s, begin_s + in_file), (end_s - in_file, end_s)
    verdicts = [("ended before it was asked to", not ended, "; ".join(ended) or "none"),
                *_judge_growth(held, minutes, files, args.growth_percent),
                _judge_latency(arrived_s, probe.latencies_ms(), minutes),
                *_judge_frames(testbed.latest, len(arrived_s), frames, sorted(folder.glob("*.rrd")))]
    return verdicts, {"seed": args.seed, "seconds": args.seconds, "seen": {check: seen for check, _, seen in verdicts}}


def _sample(testbed: Testbed, seconds: float) -> dict[str, np.ndarray]:
    """What the processes hold, by "NAME, KIND", once a second."""
    held, shared, began_s = defaultdict(list), set(), time.monotonic()
    processes = {name: psutil.Process(process.pid) for name, process in testbed.items()}
    for second in tqdm(range(int(seconds) - 1), unit="s", mininterval=1 if sys.stderr.isatty() else 30):
        for name, process in processes.items():
            held[f"{name}, memory in MB"].append(process.memory_info().rss / MB)
            held[f"{name}, files"].append(process.num_fds())
            held[f"{name}, threads"].append(process.num_threads())
            maps = Path(f"/proc/{process.pid}/maps").read_text()
            shared |= {Path(path) for path in re.findall(r"/dev/shm/\S+$", maps, re.MULTILINE)}
        held["/dev/shm, files"].append(sum(path.exists() for path in shared))
        testbed.spin(max(began_s + second + 1 - time.monotonic(), 0))
        if testbed.failed():
            break
    return {what: np.array(values) for what, values in held.items()}


def _judge_growth(held: dict[str, np.ndarray], minutes, files, growth_percent: float) -> list[tuple[str, bool, str]]:
    verdicts = []
    for what, values in held.items():
        second = np.arange(len(values))
        first, last = files if "memory" in what else ((0, minutes[0][1]), minutes[1])
        before, after = (values[(begin <= second) & (second <= end)].max() for begin, end in (first, last))
        allowed = before * (1 + growth_percent / 100) if "memory" in what else before
        verdicts.append((what, bool(after <= allowed), f"{before:.0f} → {after:.0f}"))
    return verdicts


def _judge_latency(arrived_s: np.ndarray, latency_ms: np.ndarray, minutes) -> tuple[str, bool, str]:
    before, after = (np.percentile(latency_ms[(begin <= arrived_s) & (arrived_s <= end)], 95) for begin, end in minutes)
    return "latency, 95 %", bool(after <= before * (1 + LATENCY_PERCENT / 100)), f"{before:.1f} → {after:.1f} ms"


def _judge_frames(latest: dict, clouds: int, frames: int, parts: list[Path]) -> list[tuple[str, bool, str]]:
    """Whether every frame became a cloud and was recorded. Keeps the first recording only."""
    sent = int(latest["player"]["frames_sent"])
    recorded = sum(len(RecordingReader(part).cloud_index()) for part in parts)
    size_gb = sum(part.stat().st_size for part in parts) * 1e-9
    for part in parts[1:]:
        part.unlink()
    lost = [f"{name} {key} {values[key]}" for name, values in latest.items() for key in ZERO if int(values.get(key, 0))]
    return [("frames", frames == sent == clouds == recorded, f"{frames} asked for, {sent} sent, {clouds} clouds, "
             f"{recorded} in {len(parts)} recordings of {size_gb:.2f} GB"),
            ("dropped, lost, errors", not lost, ", ".join(lost) or "none")]
