"""`srt3d demo`, which `make demo` runs: photons to clouds to a recording, by ROS 2 nodes in processes of their own."""

import argparse
import importlib
import json
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from srt3d_ros.core.metrics import Metrics, evaluate
from srt3d_ros.core.reconstructor import Reconstructor
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.stream import SketchStream
from srt3d_ros.datasets import read
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.processes import children
from srt3d_ros.processes.node_names import FRAMES_LOST
from srt3d_ros.processes.private_network import join_private_network

LEAST_HZ, MOST_HZ = 2.0, 5.0            # half of what simulator, nodes and recorder do on two idle cores
SHARE = 0.75                            # of the time between two frames, in which one process alone makes one
WARM_UP = 5                             # frames
SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
SIMULATED_TOLERANCE_M = 0.04            # within which a point is a true detection; RT3D's paper has 40 mm for its head
MOVING_TOLERANCE_M = 0.1
FILE_TOLERANCE_BINS = 10.0
JUDGED_FRAMES = 40                      # compared with the truth, evenly spaced: all would outlast the streaming
RESULTS = RECORDING, PICTURE, SUMMARY, LOG = "recording.rrd", "cloud.png", "summary.json", "nodes.log"
FIRST_FRAME = "the first frame's stamp is"     # in the log of the player
POLL_S = 0.1


@dataclass(frozen=True)
class Source:
    """What is played.

    Args:
        frame: its photons by number.
        at: the photons, for the picture, and the truth, depths in bins [S, rows, cols], at a time since the first
            frame, s, of frames at a rate, Hz.
    """

    title: str
    sensor: SensorModel
    frame: Callable[[int], PhotonEvents]
    at: Callable[[float, float], tuple[PhotonEvents | None, np.ndarray | None]]
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
    add("--rate-hz", metavar="HZ", type=float, help=f"default: {LEAST_HZ:g} to {MOST_HZ:g}, as fast as this machine is "
        "now")
    add("--duration-s", metavar="S", type=float, default=20.0, help="default: %(default)g")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    rate_hz = MOST_HZ if args.rate_hz is None else args.rate_hz
    require(0 < rate_hz <= 1000, "--rate-hz", rate_hz, "a rate above 0, at most 1000 Hz")
    require(1 <= round(min(args.duration_s * rate_hz, 1e6)) < 1e6, "--duration-s", args.duration_s,
            "time for 1 to 1e6 frames")
    importlib.import_module("rclpy")        # it may not be installed: before anything is written
    source = _from_file(args.photons) if args.photons else _moving(args.motion) if args.motion else _simulated()
    rate_hz = args.rate_hz or _rate_hz(source)
    frames = max(round(args.duration_s * rate_hz), 1)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in RESULTS:        # of an earlier run: they must not pass for this one's
        (args.out / name).unlink(missing_ok=True)
    join_private_network()
    code, problem = _play(source, frames, rate_hz, args.out)
    if problem:
        _say(f"srt3d demo: {problem} ({args.out / LOG})")
        return 1
    _report(source, frames, rate_hz, args.out)
    return code


def _rate_hz(source: Source) -> float:
    """A frame rate for this machine, as busy as it is now, by the median time of a few frames, after the first."""
    stream, times = SketchStream(source.sensor), []
    first, = stream.push(source.frame(0))
    reconstruct = Reconstructor(first.sensor, first.frequencies)
    reconstruct(first)
    for k in range(WARM_UP):
        started = time.perf_counter()
        for sketch in stream.push(source.frame(1 + k)):
            reconstruct(sketch)
        times.append(time.perf_counter() - started)
    frame_s = float(np.median(times))
    rate_hz = round(min(max(SHARE / frame_s, LEAST_HZ), MOST_HZ), 1)
    if rate_hz < MOST_HZ:
        _say(f"{rate_hz:g} Hz instead of {MOST_HZ:g}: a frame takes {frame_s * 1e3:.0f} ms on this machine now")
    return rate_hz


def _simulated() -> Source:
    simulator = Simulator(**SCENE)
    return Source("simulated moving scene", simulator.sensor, lambda k: simulator.frame(k)[0],
                  lambda time_s, rate_hz: simulator.frame(round(time_s * rate_hz)),
                  SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m, {"input": "simulator", **SCENE})


def _moving(motion: str) -> Source:
    from srt3d_ros.nodes.sources import PACKETS, extrinsics

    sensor = moving_sensor()
    view = MovingView(Room(), MOTIONS[motion], sensor)
    simulator = Simulator(view, sensor, **SCENE)
    return Source(f"simulated room, seen by a sensor that moves ({motion})", sensor, lambda k: simulator.frame(k)[0],
                  lambda time_s, rate_hz: (None, sensor.depth_bins(view.at(time_s)[0][None])),
                  MOVING_TOLERANCE_M / sensor.bin_width_m, {"input": "simulator", "motion": motion, **SCENE},
                  {"motion": "odom", "packets_per_frame": PACKETS, "extrinsics": extrinsics()})


def _from_file(path: str) -> Source:
    photons = read(path)
    for note in photons.notes:
        _say(f"note: {note}")
    shown = photons.frame if isinstance(photons.frame, PhotonEvents) else None
    events = photons.events
    return Source(photons.name, photons.sensor, lambda k: events,
                  lambda time_s, rate_hz: (shown, photons.reference_depth_bins), FILE_TOLERANCE_BINS,
                  {"input": str(Path(path).absolute())})


def _play(source: Source, frames: int, rate_hz: float, out: Path) -> tuple[int, str]:
    """Play all frames through the nodes, which record the clouds; returns the exit code, and what failed, in words."""
    settings = {"reconstructor.fields": "full", "player.rate_hz": rate_hz, "player.frames": frames} | {
        f"sketcher.{key}": value for key, value in source.sketcher.items()} | {
        f"player.{key}": value for key, value in source.player.items()}
    command = [sys.executable, "-P", "-m", "srt3d_ros.cli.main", "up", "--record", str(out / RECORDING),
               "--input", source.player["input"],
               *(f"-p{name}:={json.dumps(value)}" for name, value in settings.items())]
    _say("starting the nodes")
    with (out / LOG).open("w") as log:
        nodes, streaming = children.start(command, stdout=log, stderr=log), False
        try:
            while nodes.poll() is None:
                time.sleep(POLL_S)
                if not streaming and (streaming := FIRST_FRAME in (out / LOG).read_text()):
                    _say(f"streaming the {source.title} at {rate_hz:g} Hz for {frames / rate_hz:.3g} s")
        finally:
            children.stop(nodes)
    if nodes.returncode in (0, FRAMES_LOST):
        return nodes.returncode, ""
    said = re.findall("^srt3d.*", (out / LOG).read_text(), re.MULTILINE)
    return 1, said[-1] if said else children.ending(nodes)


def _report(source: Source, frames: int, rate_hz: float, out: Path) -> None:
    """Compare recorded clouds with the truth; write the picture and the summary, and print the summary."""
    from srt3d_ros.pictures.overview import draw_overview
    from srt3d_ros.review.recorded import Recorded
    from srt3d_ros.review.summary import align, rows, summarise

    recorded, sensor = Recorded.read(out / RECORDING), source.sensor
    first_ns = int(re.search(rf"{FIRST_FRAME} (\d+)", (out / LOG).read_text())[1])
    judged = set(recorded.index.frame_index[::-(-frames // JUDGED_FRAMES)].tolist())
    clouds = [cloud.placed(sensor) for cloud in recorded.reader.clouds(judged)]
    seen = [source.at((cloud.stamp_ns - first_ns) * 1e-9, rate_hz) for cloud in clouds]
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
