"""`srt3d demo`: run the whole pipeline on simulated photons and report the result; for `make demo`."""

import argparse
import importlib
import json
import math
import os
import re
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import NS_PER_S
from srt3d_ros.processes import children
from srt3d_ros.processes.node_command import FRAMES_LOST, command
from srt3d_ros.processes.private_network import join_private_network

RATE_HZ = 3.0                           # a third of what two idle cores can stream and record
SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
# Largest depth error of a true detection; 40 mm as for the head in RT3D's paper.
SIMULATED_TOLERANCE_M, MOVING_TOLERANCE_M = 0.04, 0.1
JUDGED_FRAMES = 40                      # compared with the truth: more would take longer than the streaming
RESULTS = RECORDING, PICTURE, SUMMARY, LOG_NAME = "recording.rrd", "cloud.png", "summary.json", "nodes.log"
FIRST_STAMP = re.compile(r"\[player\]: first stamp: (\d+) ns\n")
POLL_NODES_S = 0.1


@dataclass(frozen=True)
class Played:
    """What the demo plays.

    Args:
        at: gives the photons for the picture and the true depths in bins [S, rows, cols], from the time since the first
            frame, s, and the frame rate, Hz.
        tolerance_bins: largest depth error of a true detection.
        settings: parameters, as NODE.PARAMETER.
    """

    title: str
    sensor: SensorModel
    at: Callable[[float, float], tuple[PhotonEvents | None, np.ndarray]]
    tolerance_bins: float
    settings: dict[str, object] = field(default_factory=dict)


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "demo",
        description="Run player, sketcher, reconstructor and recorder as processes, stream a simulated moving scene "
                    "through them, and report the accuracy, the latency and the losses.")
    add = parser.add_argument
    add("--motion", choices=tuple(MOTIONS),
        help="simulate a sensor that moves through a room, and deskew its frames by odometry")
    add("--out", metavar="DIR", type=Path, default=Path("demo-out"),
        help="folder for the results (default: %(default)s)")
    add("--rate-hz", metavar="HZ", type=float, default=RATE_HZ,
        help="frames per second; fewer if frames are lost (default: %(default)g)")
    add("--duration-s", metavar="S", type=float, default=20.0, help="seconds to play (default: %(default)g)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    require(0 < args.rate_hz <= 1000, "--rate-hz", args.rate_hz, "a rate above 0, at most 1000 Hz")
    require(1 <= round(min(args.duration_s * args.rate_hz, 1e6)) < 1e6, "--duration-s", args.duration_s,
            "time for 1 to 1e6 frames")
    importlib.import_module("rclpy")        # fails before anything is written if ROS 2 is not installed
    played = _moving(args.motion) if args.motion else _simulated()
    frames = round(args.duration_s * args.rate_hz)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in RESULTS:        # results of an earlier run
        (args.out / name).unlink(missing_ok=True)
    join_private_network()
    code, problem, first_ns = _play(played, frames, args.rate_hz, args.out)
    if problem:
        _say(f"srt3d demo: {problem} ({args.out / LOG_NAME})")
        return 1
    _report(played, frames, args.rate_hz, args.out, first_ns)
    return code


def _simulated() -> Played:
    simulator = Simulator(**SCENE)
    return Played("simulated moving scene", simulator.sensor,
                  lambda time_s, rate_hz: simulator.frame(round(time_s * rate_hz)),
                  SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m)


def _moving(motion: str) -> Played:
    from srt3d_ros.nodes.sources import PACKETS, extrinsics

    sensor = moving_sensor()
    view = MovingView(Room(), MOTIONS[motion], sensor)
    return Played(f"simulated room, seen by a moving sensor ({motion})", sensor,
                  lambda time_s, rate_hz: (None, sensor.depth_bins(view.at(time_s)[0][None])),
                  MOVING_TOLERANCE_M / sensor.bin_width_m,
                  {"player.motion": motion, "sketcher.motion": "odom", "sketcher.packets_per_frame": PACKETS,
                   "sketcher.extrinsics": extrinsics()})


def _play(played: Played, frames: int, rate_hz: float, out: Path) -> tuple[int, str, int]:
    """Run the nodes on all frames and record the clouds; returns exit code, error, and the first frame's stamp."""
    settings = {"reconstructor.fields": "full", "player.rate_hz": rate_hz, "player.frames": frames,
                **{f"player.{key}": value for key, value in SCENE.items()}, **played.settings}
    up = command("up", "--record", str(out / RECORDING), "--input", "simulator",
                 *(f"-p{name}:={json.dumps(value)}" for name, value in settings.items()))
    _say("starting the nodes")
    log, first = out / LOG_NAME, None
    with log.open("w") as file:
        nodes = children.start(up, stdout=file, stderr=file)
    try:
        while nodes.poll() is None:
            time.sleep(POLL_NODES_S)
            if first is None and (first := FIRST_STAMP.search(log.read_text())):
                _say(f"streaming the {played.title} at {rate_hz:g} Hz for {frames / rate_hz:.3g} s")
    finally:
        children.stop(nodes)
    if first and nodes.returncode in (0, FRAMES_LOST):
        return nodes.returncode, "", int(first[1])
    errors = [line for line in log.read_text().splitlines() if line.startswith("srt3d")]
    return 1, errors[-1] if errors else children.ending(nodes), 0


def _report(played: Played, frames: int, rate_hz: float, out: Path, first_ns: int) -> None:
    """Compare recorded clouds with the truth, write picture and summary, and print the summary."""
    from srt3d_ros.pictures.overview import draw_overview
    from srt3d_ros.review.recorded import Recorded
    from srt3d_ros.review.summary import align, rows, summarise

    recorded, sensor = Recorded(out / RECORDING), played.sensor
    step = math.ceil(frames / JUDGED_FRAMES)
    judged = set(recorded.index.frame_index[::step].tolist())
    clouds = [cloud.placed(sensor) for cloud in recorded.clouds(judged)]
    expected = [played.at((cloud.stamp_ns - first_ns) / NS_PER_S, rate_hz) for cloud in clouds]
    metrics = [evaluate(cloud, truth, played.tolerance_bins, sensor.num_bins)
               for cloud, (_, truth) in zip(clouds, expected)]
    summary = summarise(recorded)
    bin_mm = sensor.bin_width_m * 1e3
    true, false, dae_bins = np.nanmean(
        [(one.true_detections, one.false_detections, one.dae_bins) for one in metrics], axis=0)
    facts = {"source": played.title, "frames_sent": frames, "frames_lost": frames - summary["frames"],
             "frames_judged": len(metrics), "tolerance_mm": round(played.tolerance_bins * bin_mm, 2),
             "true_detections_percent": round(100 * true, 2), "false_detections_percent": round(100 * false, 2),
             "dae_bins": round(dae_bins, 3), "dae_mm": round(dae_bins * bin_mm, 3)}
    drawn = len(clouds) // 4        # when the simulated head looks towards the eye, and its nose hides nothing
    figures = {"photons per pixel": summary["ppp"]["median"], "points": len(clouds[drawn]),
               "latency": f"{summary['latency_ms']['total']['p50']:.0f} ms",
               "mean depth error": f"{facts['dae_mm']:.3g} mm"}
    draw_overview(out / PICTURE, clouds[drawn], expected[drawn][0], played.title, figures)
    (out / SUMMARY).write_text(json.dumps(summary | facts, indent=2) + "\n")
    _say("\n" + align([*rows(summary), *((name.replace("_", " "), str(value)) for name, value in facts.items())]))
    viewer = "rerun" if shutil.which("rerun") else os.path.relpath(Path(sys.executable).with_name("rerun"))
    _say(f"\n{out}/  {PICTURE}  {RECORDING}  {SUMMARY}  {LOG_NAME}\n{viewer} {out / RECORDING}   # shows the recording")


def _say(text: str) -> None:
    print(text, flush=True)
