"""`srt3d demo`, which `make demo` runs: photons to clouds to a recording, by ROS 2 nodes in processes of their own."""

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from srt3d_ros import __version__, processes
from srt3d_ros.cli.node import node_command
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets import read
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages import points
from srt3d_ros.private_network import join_private_network

RATE_HZ = 5.0                           # half of what simulator, nodes and recorder do on two idle cores
SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
SIMULATED_TOLERANCE_M = 0.04            # within which a point is a true detection; RT3D's paper has 40 mm for its head
MOVING_TOLERANCE_M = 0.1
FILE_TOLERANCE_BINS = 10.0
JUDGED_FRAMES = 40                      # compared with the truth, evenly spaced: all would outlast the streaming
PIPELINE = {"recorder", "reconstructor", "sketcher"}
RESULTS = RECORDING, PICTURE, SUMMARY = "recording.rrd", "cloud.png", "summary.json"
START_TIMEOUT_S = 900.0                 # the reconstructor compiles: on a slow machine with other work, minutes
CLOUD_TIMEOUT_S = 60.0                  # between two clouds
LAST_CLOUD_TIMEOUT_S = 5.0              # after the player is done


@dataclass(frozen=True)
class Source:
    """What is played.

    Args:
        truth: the true depths at a time since the first frame, s: bins [S, rows, cols], or None.
        tolerance_bins: a point so near to the truth is a true detection.
        player, sketcher: their parameters for it.
        photons: at such a time, for the picture; None: it shows none.
        notes: for the user.
    """

    title: str
    sensor: SensorModel
    truth: Callable[[float], np.ndarray | None]
    tolerance_bins: float
    player: dict[str, object]
    photons: Callable[[float], PhotonEvents | None] = lambda time_s: None
    sketcher: dict[str, object] = field(default_factory=dict)
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
    source = (_from_file(args.photons) if args.photons else _moving(args.motion) if args.motion
              else _simulated(args.rate_hz))
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


def _simulated(rate_hz: float) -> Source:
    simulator = Simulator(**SCENE)
    return Source("simulated moving scene", simulator.sensor,
                  lambda time_s: simulator.expected(round(time_s * rate_hz))[0],
                  SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m, {"input": "simulator", **SCENE},
                  lambda time_s: simulator.frame(round(time_s * rate_hz))[0])


def _moving(motion: str) -> Source:
    from srt3d_ros.nodes.sources import PACKETS, extrinsics

    sensor = moving_sensor()
    view = MovingView(Room(), MOTIONS[motion], sensor)
    return Source(f"simulated room, seen by a sensor that moves ({motion})", sensor,
                  lambda time_s: sensor.depth_bins(view.at(time_s)[0][None]),
                  MOVING_TOLERANCE_M / sensor.bin_width_m, {"input": "simulator", "motion": motion, **SCENE},
                  sketcher={"motion": "odom", "packets_per_frame": PACKETS, "extrinsics": extrinsics()})


def _from_file(path: str) -> Source:
    photons = read(path)
    shown = photons.frame if isinstance(photons.frame, PhotonEvents) else None
    return Source(photons.name, photons.sensor, lambda time_s: photons.reference_depth_bins, FILE_TOLERANCE_BINS,
                  {"input": os.path.abspath(path)}, lambda time_s: shown, notes=photons.notes)


def _stream(source: Source, frames: int, rate_hz: float, out: Path) -> tuple[dict, list[str]]:
    """Play all frames through the nodes; returns the summary and what went wrong, in words."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe

    programs: dict[Path, subprocess.Popen] = {}         # by their logs
    with PipelineProbe(-(-frames // JUDGED_FRAMES)) as probe:
        try:
            _start(programs, out / "logs" / "nodes.log", _pipeline(source, out / RECORDING))
            _say("starting the nodes; the first time they compile their kernels, for about a minute")
            ready = probe.spin_until(lambda: PIPELINE <= probe.statuses.keys() or _problems(programs), START_TIMEOUT_S)
            if ready and not _problems(programs):
                _say(f"streaming the {source.title} at {rate_hz:g} Hz")
                _start(programs, out / "logs" / "player.log",
                       node_command("player", rate_hz=rate_hz, frames=frames, **source.player))
                _watch(probe, programs, frames)
        finally:
            problems = _problems(programs)
            processes.stop_in_order(reversed(programs.values()))
        probe.spin_until(lambda: all(values["state"] == "finalized" for values in probe.statuses.values()),
                         LAST_CLOUD_TIMEOUT_S)      # for their last reports
        problems = problems or _problems(programs)
    if not probe.arrivals:
        return {}, problems or [f"no cloud came, see {out / 'logs'}"]
    _say("comparing with the truth and drawing")
    clouds = [points.decode_cloud(raw, source.sensor) for raw in probe.kept]
    summary = _summarise(source, probe, clouds, rate_hz)
    if summary["frames_lost"]:
        _say(f"{summary['frames_lost']} of {summary['frames_sent']} frames were dropped: this machine is too slow or "
             f"too busy for {rate_hz:g} Hz; --rate-hz plays more slowly")
    shown = clouds[3 * len(clouds) // 4]
    _draw(out / PICTURE, source, shown, source.photons(_time_s(shown, probe)), summary)
    return summary, problems


def _pipeline(source: Source, recording: Path) -> list[str]:
    """The command of all nodes but the player."""
    parameters = {"reconstructor.fields": "full"} | {f"sketcher.{name}": value for name, value in
                                                     source.sketcher.items()}
    return [sys.executable, "-m", "srt3d_ros.cli.main", "up", "--record", str(recording),
            *(f"-p{name}:={json.dumps(value)}" for name, value in parameters.items())]


def _start(programs: dict[Path, subprocess.Popen], log: Path, command: list[str]) -> None:
    log.parent.mkdir(exist_ok=True)
    with log.open("w") as output:
        programs[log] = processes.start(command, stdout=output, stderr=output)


def _problems(programs: dict[Path, subprocess.Popen]) -> list[str]:
    """Why each program that has failed did, in its words; SIGTERM may end an exiting Python."""
    found = []
    for log in [log for log, program in programs.items() if program.poll() not in (None, 0, -signal.SIGTERM)]:
        lines = log.read_text().splitlines() or [processes.ending(programs[log])]
        said = [line for line in lines if line.startswith("srt3d")] or lines
        found.append(f"{said[-1]} ({log})")
    return found


def _watch(probe, programs: dict[Path, subprocess.Popen], frames: int) -> None:
    """Show the clouds as they come, until all are here or no more will come."""
    def moved() -> bool:
        return len(probe.arrivals) > bar.n or bool(_problems(programs))

    with tqdm(total=frames, unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 2.0) as bar:
        while bar.n < frames and not _problems(programs):
            probe.spin_until(lambda: moved() or any(program.poll() == 0 for program in programs.values()),
                             CLOUD_TIMEOUT_S)
            if not probe.spin_until(moved, LAST_CLOUD_TIMEOUT_S):
                return
            bar.update(len(probe.arrivals) - bar.n)


def _time_s(cloud: PointCloud, probe) -> float:
    """When the sensor saw a cloud, since the first frame."""
    return (cloud.stamp_ns - probe.total("player", "first_stamp_ns")) * 1e-9


def _summarise(source: Source, probe, clouds: list[PointCloud], rate_hz: float) -> dict:
    """What is printed and written of a run; these clouds are compared with the truth where there is one."""
    sensor, arrivals = source.sensor, probe.arrivals
    latencies_ms = [arrival.latency_ms for arrival in arrivals]
    streamed_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
    sent = probe.total("player", "frames_sent") // source.sketcher.get("packets_per_frame", 1)
    summary = {
        "source": source.title, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
        "rate_hz": rate_hz, "frames_sent": sent, "frames_reconstructed": len(arrivals),
        "frames_lost": sent - len(arrivals),
        "clouds_per_second": round((len(arrivals) - 1) / streamed_s, 2) if streamed_s else 0.0,
        "latency_median_ms": round(float(np.median(latencies_ms)), 1),
        "latency_p95_ms": round(float(np.percentile(latencies_ms, 95)), 1),
        "photons_per_frame": probe.total("player", "photons_sent") // max(sent, 1),
        "points_per_frame": int(np.median([arrival.points for arrival in arrivals])),
        "version": __version__, "machine": f"{platform.machine()}, {os.cpu_count()} CPUs"}
    truths = [source.truth(_time_s(cloud, probe)) for cloud in clouds]
    found = [evaluate(cloud, truth, source.tolerance_bins, sensor.num_bins) for cloud, truth in zip(clouds, truths)
             if truth is not None]
    if found:
        dae_bins = float(np.nanmean([metrics.dae_bins for metrics in found]))
        summary |= {
            "frames_judged": len(found), "tolerance_mm": round(source.tolerance_bins * sensor.bin_width_m * 1e3, 2),
            "true_detections_percent": round(100 * float(np.mean([metrics.true_detections for metrics in found])), 2),
            "false_detections_percent": round(100 * float(np.mean([metrics.false_detections for metrics in found])), 2),
            "dae_bins": round(dae_bins, 3), "dae_mm": round(dae_bins * sensor.bin_width_m * 1e3, 3)}
    return summary


def _draw(path: Path, source: Source, cloud: PointCloud, photons: PhotonEvents | None, summary: dict) -> None:
    from srt3d_ros.pictures.overview import draw_overview

    figures = {"photons per pixel": summary["photons_per_frame"] / source.sensor.pixels, "points": len(cloud),
               "latency": f"{summary['latency_median_ms']:.0f} ms"}
    if "dae_mm" in summary:
        figures["mean depth error"] = f"{summary['dae_mm']:.3g} mm"
    draw_overview(path, cloud, source.sensor, photons, source.title, figures)


def _say(text: str) -> None:
    print(text, flush=True)
