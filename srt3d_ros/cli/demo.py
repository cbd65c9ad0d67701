"""`srt3d demo`, which `make demo` runs: photons to clouds to a recording, by ROS 2 nodes in processes of their own."""

import argparse
import importlib
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from srt3d_ros import processes
from srt3d_ros.cli.node import node_command
from srt3d_ros.core.metrics import Metrics, evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets import read
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.private_network import join_private_network

RATE_HZ = 5.0                           # half of what simulator, nodes and recorder do on two idle cores
SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
SIMULATED_TOLERANCE_M = 0.04            # within which a point is a true detection; RT3D's paper has 40 mm for its head
MOVING_TOLERANCE_M = 0.1
FILE_TOLERANCE_BINS = 10.0
JUDGED_FRAMES = 40                      # compared with the truth, evenly spaced: all would outlast the streaming
PIPELINE = ("recorder", "reconstructor", "sketcher")
RESULTS = RECORDING, PICTURE, SUMMARY, LOG = "recording.rrd", "cloud.png", "summary.json", "nodes.log"
LAST_CLOUD_S = 2.0                      # after the player's end: no more will come
POLL_S = 0.1


@dataclass(frozen=True)
class Source:
    """What is played; `at` gives the photons, for the picture, and the truth at a time since the first frame."""

    title: str
    sensor: SensorModel
    at: Callable[[float], tuple[PhotonEvents | None, np.ndarray | None]]    # truth: depths in bins, [S, rows, cols]
    tolerance_bins: float               # a point so near to the truth is a true detection
    player: dict[str, object]           # its parameters
    sketcher: dict[str, object] = field(default_factory=dict)


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "demo", help="the whole pipeline over ROS 2 on this machine: a recording, a picture and a table",
        description="Start player, sketcher, reconstructor and recorder as processes of their own, stream a simulated "
                    "moving scene or a photon file through them, and report what came out.")
    add, source = parser.add_argument, parser.add_mutually_exclusive_group()
    source.add_argument("--photons", metavar="FILE", help="photon file to stream instead of the simulated scene")
    source.add_argument("--motion", choices=tuple(MOTIONS), help="stream what a sensor sees that moves through a room, "
                        "and deskew it by its odometry")
    add("--out", metavar="DIR", type=Path, default=Path("demo-out"), help="default: %(default)s")
    add("--rate-hz", metavar="HZ", type=float, default=RATE_HZ, help="default: %(default)g, less if frames are lost")
    add("--duration-s", metavar="S", type=float, default=20.0, help="default: %(default)g")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    require(0 < args.rate_hz <= 1000, "--rate-hz", args.rate_hz, "a rate above 0, at most 1000 Hz")
    frames = round(min(args.duration_s * args.rate_hz, 1e6))
    require(1 <= frames < 1e6, "--duration-s", args.duration_s, "time for 1 to 1e6 frames")
    importlib.import_module("rclpy")        # it may not be installed: before anything is written
    source = (_from_file(args.photons) if args.photons else _moving(args.motion) if args.motion
              else _simulated(args.rate_hz))
    args.out.mkdir(parents=True, exist_ok=True)
    for name in RESULTS:        # of an earlier run: they must not pass for this one's
        (args.out / name).unlink(missing_ok=True)
    join_private_network()
    if problem := _play(source, frames, args.rate_hz, args.out):
        _say(f"srt3d demo: {problem} ({args.out / LOG})")
        return 1
    _report(source, frames, args.out)
    return 0


def _simulated(rate_hz: float) -> Source:
    simulator = Simulator(**SCENE)
    return Source("simulated moving scene", simulator.sensor, lambda time_s: simulator.frame(round(time_s * rate_hz)),
                  SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m, {"input": "simulator", **SCENE})


def _moving(motion: str) -> Source:
    from srt3d_ros.nodes.sources import PACKETS, extrinsics

    sensor = moving_sensor()
    view = MovingView(Room(), MOTIONS[motion], sensor)
    return Source(f"simulated room, seen by a sensor that moves ({motion})", sensor,
                  lambda time_s: (None, sensor.depth_bins(view.at(time_s)[0][None])),
                  MOVING_TOLERANCE_M / sensor.bin_width_m, {"input": "simulator", "motion": motion, **SCENE},
                  {"motion": "odom", "packets_per_frame": PACKETS, "extrinsics": extrinsics()})


def _from_file(path: str) -> Source:
    photons = read(path)
    for note in photons.notes:
        _say(f"note: {note}")
    shown = photons.frame if isinstance(photons.frame, PhotonEvents) else None
    return Source(photons.name, photons.sensor, lambda time_s: (shown, photons.reference_depth_bins),
                  FILE_TOLERANCE_BINS, {"input": Path(path).absolute()})


def _play(source: Source, frames: int, rate_hz: float, out: Path) -> str:
    """Play all frames through the nodes, which record the clouds; returns what went wrong, in words."""
    programs: list[subprocess.Popen] = []
    settings = {"reconstructor.fields": "full"} | {f"sketcher.{key}": value for key, value in source.sketcher.items()}

    def failed() -> list[subprocess.Popen]:     # SIGTERM may end an exiting Python
        return [program for program in programs if program.poll() not in (None, 0, -signal.SIGTERM)]

    with (out / LOG).open("w") as log:
        try:
            _say("starting the nodes; the first time they compile their kernels, for about a minute")
            programs.append(processes.start(
                [sys.executable, "-P", "-m", "srt3d_ros.cli.main", "up", "--record", str(out / RECORDING),
                 *(f"-p{name}:={json.dumps(value)}" for name, value in settings.items())], stdout=log, stderr=log))
            while not all(f"[{name}]: ready" in (out / LOG).read_text() for name in PIPELINE) and not failed():
                time.sleep(POLL_S)
            if not failed():
                _say(f"streaming the {source.title} at {rate_hz:g} Hz for {frames / rate_hz:.3g} s")
                player = node_command("player", rate_hz=rate_hz, frames=frames, **source.player)
                programs.append(processes.start(player, stdout=log, stderr=log))
            while all(program.poll() is None for program in programs):
                time.sleep(POLL_S)
            time.sleep(LAST_CLOUD_S)
        finally:
            processes.stop_in_order(reversed(programs))
    said = re.findall("^srt3d.*", (out / LOG).read_text(), re.MULTILINE)
    return "".join(said[-1:] or map(processes.ending, failed())) if failed() else ""


def _report(source: Source, frames: int, out: Path) -> None:
    """Compare recorded clouds with the truth; write the picture and the summary, and print the summary."""
    from srt3d_ros.pictures.overview import draw_overview
    from srt3d_ros.review.recorded import Recorded
    from srt3d_ros.review.summary import align, rows, summarise

    recorded, sensor = Recorded.read(out / RECORDING), source.sensor
    first_ns = int(re.search(r"first frame's stamp is (\d+)", (out / LOG).read_text())[1])
    judged = set(recorded.index.frame_index[::-(-frames // JUDGED_FRAMES)].tolist())
    clouds = [cloud.placed(sensor) for cloud in recorded.reader.clouds(judged)]
    seen = [source.at((cloud.stamp_ns - first_ns) * 1e-9) for cloud in clouds]
    found = [evaluate(cloud, truth, source.tolerance_bins, sensor.num_bins) for cloud, (_, truth) in zip(clouds, seen)
             if truth is not None]
    summary, k = summarise(recorded), 3 * len(clouds) // 4
    own = {"source": source.title, "frames_sent": frames, "frames_lost": frames - summary["frames"]}
    figures = {"photons per pixel": summary["ppp"]["median"], "points": len(clouds[k]),
               "latency": f"{summary['latency_ms']['total']['p50']:.0f} ms"}
    if found:
        own |= _accuracy(found, source.tolerance_bins, sensor.bin_width_m * 1e3)
        figures["mean depth error"] = f"{own['dae_mm']:.3g} mm"
    draw_overview(out / PICTURE, clouds[k], sensor, seen[k][0], source.title, figures)
    (out / SUMMARY).write_text(json.dumps(summary | own, indent=2) + "\n")
    _say("\n" + align([*rows(summary), *((name.replace("_", " "), str(value)) for name, value in own.items())]))
    _say(f"\n{out}/  {PICTURE}  {RECORDING} (to open with `rerun`)  {SUMMARY}  {LOG}")


def _accuracy(found: list[Metrics], tolerance_bins: float, bin_mm: float) -> dict[str, float]:
    true, false, dae_bins = np.nanmean([(one.true_detections, one.false_detections, one.dae_bins) for one in found], 0)
    return {"frames_judged": len(found), "tolerance_mm": round(tolerance_bins * bin_mm, 2),
            "true_detections_percent": round(100 * true, 2), "false_detections_percent": round(100 * false, 2),
            "dae_bins": round(dae_bins, 3), "dae_mm": round(dae_bins * bin_mm, 3)}


def _say(text: str) -> None:
    print(text, flush=True)
