"""`srt3d demo`, which `make demo` runs: photons to clouds to a recording, by ROS 2 nodes in processes of their own."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from srt3d_ros import __version__
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import open_photons
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages import points
from srt3d_ros.private_network import join_private_network
from srt3d_ros.processes import LoggedNodes

RATE_HZ = 5.0                           # half of what simulator, nodes and recorder do on two idle cores
SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
SIMULATED_TOLERANCE_M = 0.04            # within which a point is a true detection; RT3D's paper has 40 mm for its head
MOVING_TOLERANCE_M = 0.1
FILE_TOLERANCE_BINS = 10.0
JUDGED_FRAMES = 40                      # compared with the truth, evenly spaced: all would outlast the streaming
PIPELINE = ("recorder", "reconstructor", "sketcher")    # started before the player, so that all listen to it
RESULTS = RECORDING, PICTURE, SUMMARY = "recording.rrd", "cloud.png", "summary.json"
START_TIMEOUT_S = 900.0                 # the reconstructor compiles: on a slow machine with other work, minutes
CLOUD_TIMEOUT_S = 60.0                  # between two clouds
LAST_CLOUD_TIMEOUT_S = 5.0              # after the player is done


@dataclass(frozen=True)
class Source:
    """What is played.

    Args:
        truth: the true depths of frame k, bins [S, rows, cols], or None.
        tolerance_bins: a point so near to the truth is a true detection.
        player, sketcher: their parameters for it.
        photons: of frame k, for the picture; None: it shows none.
        packets: messages in a frame.
        stamped: the instant of a frame that its cloud is stamped with, 0 its start, 1 its end.
        notes: for the user.
    """

    title: str
    sensor: SensorModel
    truth: Callable[[int], np.ndarray | None]
    tolerance_bins: float
    player: dict[str, object]
    photons: Callable[[int], PhotonEvents | None] = lambda k: None
    sketcher: dict[str, object] = field(default_factory=dict)
    packets: int = 1
    stamped: float = 0.0
    notes: tuple[str, ...] = ()


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "demo", help="the whole pipeline over ROS 2 on this machine: a recording, a picture and a table",
        description="Start player, sketcher, reconstructor and recorder as processes of their own, stream a simulated "
                    "moving scene or a photon file through them, and report what came out.")
    parser.add_argument("--photons", metavar="FILE", help="photon file to stream instead of the simulated scene")
    parser.add_argument("--motion", choices=tuple(MOTIONS), help="stream what a sensor sees that moves through a room, "
                        "and deskew it by its odometry")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("demo-out"), help="default: %(default)s")
    parser.add_argument("--rate-hz", metavar="HZ", type=float, default=RATE_HZ, help="default: %(default)g")
    parser.add_argument("--duration-s", metavar="S", type=float, default=20.0, help="default: %(default)g")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    require(0 < args.rate_hz <= 1000, "--rate-hz", args.rate_hz, "a rate above 0, at most 1000 Hz")
    frames = args.duration_s * args.rate_hz
    require(1 <= frames < 1e6, "--duration-s", args.duration_s, "time for 1 to 1e6 frames")
    require(not (args.photons and args.motion), "--motion", args.motion, "nothing beside --photons: files do not move")
    source = (_from_file(args.photons) if args.photons else _moving(args.motion, args.rate_hz) if args.motion
              else _simulated())
    for note in source.notes:
        _say(f"note: {note}")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in RESULTS:        # of an earlier run: they must not pass for this one's
        (args.out / name).unlink(missing_ok=True)
    join_private_network()
    summary, problems = _stream(source, round(frames), args.rate_hz, args.out)
    if summary:
        (args.out / SUMMARY).write_text(json.dumps(summary, indent=2) + "\n")
        _say("\n" + "\n".join(f"  {name.replace('_', ' '):<26}{value}" for name, value in summary.items()))
        _say(f"\n{args.out}/  {PICTURE}  {RECORDING} (to open with `srt3d view`)  {SUMMARY}  logs/")
    for problem in problems:
        _say(f"srt3d demo: {problem}")
    return 1 if problems else 0


def _simulated() -> Source:
    simulator = Simulator(**SCENE)
    return Source("simulated moving scene", simulator.sensor, lambda k: simulator.expected(k)[0],
                  SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m, {"input": "simulator", **SCENE},
                  lambda k: simulator.frame(k)[0])


def _moving(motion: str, rate_hz: float) -> Source:
    from srt3d_ros.nodes.moving_source import PACKETS, extrinsics

    sensor = moving_sensor()
    view = MovingView(Room(), MOTIONS[motion], sensor)
    return Source(f"simulated room, seen by a sensor that moves ({motion})", sensor,
                  lambda k: sensor.depth_bins(view.at((k + 0.5) / rate_hz)[0][None]),
                  MOVING_TOLERANCE_M / sensor.bin_width_m, {"input": "simulator", "motion": motion, **SCENE},
                  sketcher={"motion": "odom", "packets_per_frame": PACKETS, "extrinsics": extrinsics()},
                  packets=PACKETS, stamped=0.5)


def _from_file(path: str) -> Source:
    photons = open_photons(path)
    shown = photons.frame if isinstance(photons.frame, PhotonEvents) else None
    return Source(photons.name, photons.sensor, lambda k: photons.reference_depth_bins, FILE_TOLERANCE_BINS,
                  {"input": os.path.abspath(path)}, lambda k: shown, notes=photons.notes)


def _stream(source: Source, frames: int, rate_hz: float, out: Path) -> tuple[dict, list[str]]:
    """Play all frames through the nodes; returns the summary and what went wrong, in words."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe

    with PipelineProbe(-(-frames // JUDGED_FRAMES)) as probe, LoggedNodes(out / "logs") as nodes:
        nodes.start("recorder", path=str(out / RECORDING))
        nodes.start("reconstructor", fields="full")
        nodes.start("sketcher", **source.sketcher)
        _say("starting the nodes; the first time they compile their kernels, for about a minute")
        if not probe.spin_until(lambda: {*PIPELINE} <= probe.statuses.keys() or nodes.failed(), START_TIMEOUT_S):
            return {}, [f"the nodes were not ready after {START_TIMEOUT_S:.0f} s, see {out / 'logs'}"]
        if nodes.failed():
            return {}, nodes.failed()
        _say(f"streaming the {source.title} at {rate_hz:g} Hz")
        nodes.start("player", rate_hz=rate_hz, frames=frames, **source.player)
        _watch(probe, nodes, frames)
        problems = nodes.failed()
        nodes.stop()
        probe.spin_until(lambda: all(values["state"] == "finalized" for values in probe.statuses.values()),
                         LAST_CLOUD_TIMEOUT_S)      # for their last reports
        problems = problems or nodes.failed()
    if not probe.arrivals:
        return {}, problems or ["no cloud came"]
    _say("comparing with the truth and drawing")
    clouds = {_frame_index(cloud, source, probe, rate_hz): cloud
              for cloud in (points.decode_cloud(raw, source.sensor) for raw in probe.kept)}
    summary = _summarise(source, probe, clouds, rate_hz)
    if summary["frames_lost"]:
        _say(f"{summary['frames_lost']} of {summary['frames_sent']} frames were dropped: this machine is too slow or "
             f"too busy for {rate_hz:g} Hz; --rate-hz plays more slowly")
    _draw(out / PICTURE, source, clouds, summary)
    return summary, problems


def _watch(probe, nodes: LoggedNodes, frames: int) -> None:
    """Show the clouds as they come, until all are here or no more will come."""
    def moved() -> bool:
        return len(probe.arrivals) > bar.n or bool(nodes.failed())

    with tqdm(total=frames, unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 2.0) as bar:
        while bar.n < frames and not nodes.failed():
            probe.spin_until(lambda: moved() or nodes.ended("player"), CLOUD_TIMEOUT_S)
            if not probe.spin_until(moved, LAST_CLOUD_TIMEOUT_S):
                return
            bar.update(len(probe.arrivals) - bar.n)


def _frame_index(cloud: PointCloud, source: Source, probe, rate_hz: float) -> int:
    """Which of the player's frames a cloud shows: the player stamps frame k with first stamp + k / rate."""
    return round((cloud.stamp_ns - int(probe.value("player", "first_stamp_ns"))) * 1e-9 * rate_hz - source.stamped)


def _summarise(source: Source, probe, clouds: dict[int, PointCloud], rate_hz: float) -> dict:
    """What is printed and written of a run; clouds by frame are compared with the truth where there is one."""
    sensor, latencies_ms = source.sensor, probe.latencies_ms()
    sent, came = probe.total("player", "frames_sent") // source.packets, len(probe.arrivals)
    summary = {
        "source": source.title, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
        "rate_hz": rate_hz, "frames_sent": sent, "frames_reconstructed": came, "frames_lost": sent - came,
        "clouds_per_second": round(probe.clouds_per_second(), 2),
        "latency_median_ms": round(float(np.median(latencies_ms)), 1),
        "latency_p95_ms": round(float(np.percentile(latencies_ms, 95)), 1),
        "photons_per_frame": probe.total("player", "photons_sent") // max(sent, 1),
        "points_per_frame": int(np.median([arrival.points for arrival in probe.arrivals])),
        "version": __version__, "machine": f"{platform.machine()}, {os.cpu_count()} CPUs"}
    truths = {k: source.truth(k) for k in clouds}
    found = [evaluate(cloud, truths[k], source.tolerance_bins, sensor.num_bins) for k, cloud in clouds.items()
             if truths[k] is not None]
    if found:
        dae_bins = float(np.nanmean([metrics.dae_bins for metrics in found]))
        summary |= {
            "frames_judged": len(found), "tolerance_mm": round(source.tolerance_bins * sensor.bin_width_m * 1e3, 2),
            "true_detections_percent": round(100 * float(np.mean([metrics.true_detections for metrics in found])), 2),
            "false_detections_percent": round(100 * float(np.mean([metrics.false_detections for metrics in found])), 2),
            "dae_bins": round(dae_bins, 3), "dae_mm": round(dae_bins * sensor.bin_width_m * 1e3, 3)}
    return summary


def _draw(path: Path, source: Source, clouds: dict[int, PointCloud], summary: dict) -> None:
    from srt3d_ros.pictures.overview import draw_overview

    k = list(clouds)[3 * len(clouds) // 4]
    figures = {"photons per pixel": summary["photons_per_frame"] / source.sensor.pixels, "points": len(clouds[k]),
               "latency": f"{summary['latency_median_ms']:.0f} ms"}
    if "dae_mm" in summary:
        figures["mean depth error"] = f"{summary['dae_mm']:.3g} mm"
    draw_overview(path, clouds[k], source.sensor, source.photons(k), source.title, figures)


def _say(text: str) -> None:
    print(text, flush=True)
