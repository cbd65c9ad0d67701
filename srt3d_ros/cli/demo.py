"""`srt3d demo`, which `make demo` runs: photons to clouds to a recording, by ROS 2 nodes in processes of their own."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from srt3d_ros import __version__
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.motion import Pose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import open_photons
from srt3d_ros.datasets.motion_profiles import MOTIONS
from srt3d_ros.datasets.moving import MovingView, moving_sensor
from srt3d_ros.datasets.room import Room
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages import points
from srt3d_ros.private_network import join_private_network
from srt3d_ros.processes import Processes, node_command

SCENE = {"ppp": 15.0, "sbr": 1.0, "seed": 1}
SIMULATED_TOLERANCE_M = 0.04            # within which a point is a true detection; RT3D's paper has 40 mm for its head
MOVING_TOLERANCE_M = 0.1
FILE_TOLERANCE_BINS = 10.0
FRAMES_IN_FLIGHT = 3                    # of several packets: one that comes, one that waits for odometry, one beyond
FILM_FRAMES = 200                       # kept in memory for it, 1.3 MB each, twice
JUDGED_FRAMES = 40                      # compared with the truth, evenly spaced: all would outlast the streaming
PIPELINE = ("recorder", "reconstructor", "sketcher")    # started before the player, so that all listen to it
RESULTS = RECORDING, PICTURE, SUMMARY, FILM = "recording.rrd", "cloud.png", "summary.json", "film.rrd"
ADDED = "/photons_added"                # where the photons of a sensor that moves are added as they come, to compare
FILM_VIEWS, FILM_HEIGHTS_M = ("photons added", "parts moved"), (0.0, 2.6)       # of the room, without its ceiling
TABLE = """
{source}: {rows} × {cols} pixels, {num_bins} bins, {rate_hz:g} Hz
  frames sent           {frames_sent:>9}
  frames reconstructed  {frames_reconstructed:>9}
  frames lost           {frames_lost:>9}
  clouds per second     {clouds_per_second:>9.1f}  of {rate_hz:g} asked for
  latency, median       {latency_median_ms:>9.1f}  ms from the photons' stamp to the cloud
  latency, 95 %         {latency_p95_ms:>9.1f}  ms
  photons per frame     {photons_per_frame:>9}
  points per frame      {points_per_frame:>9}  median"""
JUDGED = """
  true detections       {true_detections_percent:>9.1f}  % of the surfaces have a point within {tolerance_mm:.3g} mm
  false detections      {false_detections_percent:>9.1f}  % more points that are farther off
  depth error (DAE)     {dae_bins:>9.2f}  bins = {dae_mm:.3g} mm"""
CLOUD_TIMEOUT_S = 60.0                  # between two clouds
LAST_CLOUD_TIMEOUT_S = 5.0              # after the player is done


@dataclass(frozen=True)
class Source:
    """What is played: its title, the sensor that sees it, the photons of frame k and the notes for the user.

    Args:
        truth: the true depths of frame k, bins [S, rows, cols], or None.
        tolerance_bins: a point so near to the truth is a true detection.
        parameters: make the player play it.
        sketcher: parameters of the sketcher for it.
        packets: messages in a frame.
        stamped: the instant of a frame that its cloud is stamped with, 0 its start, 1 its end.
        pose: of the sensor at that instant of frame k, in a fixed frame; None: it does not move.
    """

    title: str
    sensor: SensorModel
    photons: Callable[[int], PhotonEvents]
    truth: Callable[[int], np.ndarray | None]
    tolerance_bins: float
    parameters: dict[str, object]
    sketcher: dict[str, object] = field(default_factory=dict)
    packets: int = 1
    stamped: float = 0.0
    pose: Callable[[int], Pose] | None = None
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
    parser.add_argument("--rate-hz", metavar="HZ", type=float, help="default: 10, with --motion 5: the simulator of a "
                        "sensor that moves takes a tenth of a second for a frame")
    parser.add_argument("--duration-s", metavar="S", type=float, default=20.0, help="default: %(default)g")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    rate_hz = (5.0 if args.motion else 10.0) if args.rate_hz is None else args.rate_hz
    require(0 < rate_hz <= 1000, "--rate-hz", rate_hz, "a rate above 0, at most 1000 Hz")
    require(1 <= args.duration_s * rate_hz < 1e6, "--duration-s", args.duration_s, "time for 1 to 1e6 frames")
    require(not (args.photons and args.motion), "--motion", args.motion, "nothing beside --photons: files do not move")
    source = (_from_file(args.photons) if args.photons else _moving(args.motion, rate_hz) if args.motion
              else _simulated())
    for note in source.notes:
        _say(f"note: {note}")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in RESULTS:        # of an earlier run: they must not pass for this one's
        (args.out / name).unlink(missing_ok=True)
    join_private_network()
    summary, problems = _stream(source, round(args.duration_s * rate_hz), rate_hz, args.out)
    if summary:
        (args.out / SUMMARY).write_text(json.dumps(summary, indent=2) + "\n")
        print((TABLE + JUDGED * ("frames_judged" in summary)).format(**summary))
        recordings = f"{RECORDING}  {FILM}" if source.pose else RECORDING
        print(f"\n{args.out}/  {PICTURE}  {recordings} (to open with `srt3d view`)  {SUMMARY}  logs/")
    for problem in problems:
        _say(f"srt3d demo: {problem}")
    return 1 if problems else 0


def _simulated() -> Source:
    simulator = Simulator(**SCENE)
    return Source("simulated moving scene", simulator.sensor, lambda k: simulator.frame(k)[0],
                  lambda k: simulator.expected(k)[0], SIMULATED_TOLERANCE_M / simulator.sensor.bin_width_m,
                  {"input": "simulator", **SCENE})


def _moving(motion: str, rate_hz: float) -> Source:
    from srt3d_ros.nodes.moving_source import PACKETS, extrinsics

    sensor, packets_hz = moving_sensor(), PACKETS * rate_hz
    view = MovingView(Room(), MOTIONS[motion], sensor, 1 / packets_hz)
    simulator = Simulator(view, sensor, SCENE["sbr"], SCENE["ppp"] / PACKETS, SCENE["seed"], packets_hz)

    def photons(k: int) -> PhotonEvents:
        packets = [simulator.frame(k * PACKETS + packet)[0] for packet in range(PACKETS)]
        return PhotonEvents(*(np.concatenate([getattr(one, name) for one in packets]) for name in ("pixel", "toa")))

    def truth(k: int) -> np.ndarray:
        range_m = view.at((k + 0.5) / rate_hz)[0]
        return sensor.depth_bins(range_m[None])

    return Source(f"simulated room, seen by a sensor that moves ({motion})", sensor, photons, truth,
                  MOVING_TOLERANCE_M / sensor.bin_width_m,
                  {"input": "simulator", "motion": motion, "in_flight": FRAMES_IN_FLIGHT * PACKETS, **SCENE},
                  {"motion": "odom", "packets_per_frame": PACKETS, "extrinsics": extrinsics(),
                   "motion_timeout_s": CLOUD_TIMEOUT_S / 10}, PACKETS,
                  stamped=0.5, pose=lambda k: view.sensor_pose((k + 0.5) / rate_hz))


def _from_file(path: str) -> Source:
    photons = open_photons(path)
    return Source(photons.name, photons.sensor, lambda k: photons.frame, lambda k: photons.reference_depth_bins,
                  FILE_TOLERANCE_BINS, {"input": os.path.abspath(path)}, notes=photons.notes)


def _stream(source: Source, frames: int, rate_hz: float, out: Path) -> tuple[dict, list[str]]:
    """Play all frames through the nodes; returns the summary and what went wrong, in words."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    keep_every = -(-frames // (FILM_FRAMES if source.pose else JUDGED_FRAMES))
    with (PipelineProbe(keep_every, f"{ADDED}/points" if source.pose else None) as probe,
          Processes(probe.spin_until, out / "logs") as nodes):
        nodes.start("recorder", path=str(out / RECORDING))
        nodes.start("reconstructor", fields="full", lossless=True)
        nodes.start("sketcher", lossless=True, **source.sketcher)
        compared = _start_to_compare(nodes, source) if source.pose else ()
        _say("starting the nodes; the first time they compile their kernels, for about a minute")
        problems = nodes.not_ready((*PIPELINE, *compared), probe.statuses)
        if problems:
            return {}, problems
        _say(f"streaming the {source.title} at {rate_hz:g} Hz")
        nodes.start("player", rate_hz=rate_hz, frames=frames, lossless=True, **source.parameters)
        _watch(probe, nodes, frames)
        if compared:
            _say("waiting for the last clouds to compare")
            probe.spin_until(lambda: len(probe.beside) >= len(probe.kept) or nodes.failed(), LAST_CLOUD_TIMEOUT_S)
        problems = nodes.failed()
        nodes.stop()
        problems = problems or nodes.failed()
    if not probe.arrivals:
        return {}, problems or ["no cloud came"]
    _say("comparing with the truth and drawing")
    summary = _summarise(source, probe, rate_hz)
    if summary["frames_lost"]:
        problems.append(f"{summary['frames_lost']} of {summary['frames_sent']} frames were lost ({_drops(probe)})")
    _draw(out / PICTURE, source, probe, summary)
    if source.pose:
        _record_film(out / FILM, source, probe, rate_hz)
    return summary, problems


def _start_to_compare(nodes: Processes, source: Source) -> tuple[str, ...]:
    """Another sketcher, which adds the same photons without moving them, and its reconstructor; the others go first."""
    remapped = "-r", f"__ns:={ADDED}", "-r", "photons:=/photons", "-r", "sensor:=/sensor"
    both = {"reconstructor": {"fields": "full"}, "sketcher": {"packets_per_frame": source.packets}}
    names = tuple(f"{ADDED[1:]}/{name}" for name in both)
    for name, (node, parameters) in zip(names, both.items()):
        nodes.run(name, ["nice", *node_command(node, *remapped, **parameters)], is_node=True)
    return names


def _watch(probe, nodes: Processes, frames: int) -> None:
    """Show the clouds as they come, until all are here or no more will come."""
    def moved() -> bool:
        return len(probe.arrivals) > bar.n or bool(nodes.failed())

    with tqdm(total=frames, unit="cloud", mininterval=0.1 if sys.stderr.isatty() else 2.0) as bar:
        while bar.n < frames and not nodes.failed():
            if not probe.spin_until(lambda: moved() or nodes.ended("player"), CLOUD_TIMEOUT_S):
                return
            if not moved() and not probe.spin_until(moved, LAST_CLOUD_TIMEOUT_S):
                return
            bar.update(len(probe.arrivals) - bar.n)
            bar.set_postfix(latency=f"{probe.arrivals[-1].latency_ms:.0f} ms", refresh=False)


def _summarise(source: Source, probe, rate_hz: float) -> dict:
    sensor, latencies_ms = source.sensor, probe.latencies_ms()
    sent, came = probe.total("player", "frames_sent") // source.packets, len(probe.arrivals)
    return {
        "source": source.title, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
        "bin_width_s": sensor.bin_width_s, "rate_hz": rate_hz,
        "frames_sent": sent, "frames_reconstructed": came, "frames_lost": sent - came,
        "clouds_per_second": round(probe.clouds_per_second(), 2),
        "latency_median_ms": round(float(np.median(latencies_ms)), 2),
        "latency_p95_ms": round(float(np.percentile(latencies_ms, 95)), 2),
        "photons_per_frame": probe.total("player", "photons_sent") // max(sent, 1),
        "points_per_frame": int(np.median([arrival.points for arrival in probe.arrivals])),
        **_judge(source, probe, rate_hz),
        "version": __version__, "machine": f"{platform.machine()}, {os.cpu_count()} CPUs",
    }


def _judge(source: Source, probe, rate_hz: float) -> dict:
    """Detections and depth error of the clouds that were kept, against the truth at their stamps; empty without one."""
    sensor, results = source.sensor, []
    for raw in probe.kept[::-(-len(probe.kept) // JUDGED_FRAMES)]:
        cloud = points.decode_cloud(raw, sensor)
        truth = source.truth(_frame_index(cloud, source.stamped, probe, rate_hz))
        if truth is None:
            return {}
        results.append(evaluate(cloud, truth, source.tolerance_bins, sensor.num_bins))
    dae_bins = float(np.nanmean([result.dae_bins for result in results]))
    return {
        "tolerance_bins": round(source.tolerance_bins, 2),
        "tolerance_mm": round(source.tolerance_bins * sensor.bin_width_m * 1e3, 2),
        "true_detections_percent": round(100 * float(np.mean([result.true_detections for result in results])), 2),
        "false_detections_percent": round(100 * float(np.mean([result.false_detections for result in results])), 2),
        "dae_bins": round(dae_bins, 3), "dae_mm": round(dae_bins * sensor.bin_width_m * 1e3, 3),
        "frames_judged": len(results),
    }


def _draw(path: Path, source: Source, probe, summary: dict) -> None:
    from srt3d_ros.pictures.overview import draw_overview
    cloud = points.decode_cloud(probe.kept[3 * len(probe.kept) // 4], source.sensor)
    photons = source.photons(_frame_index(cloud, source.stamped, probe, summary["rate_hz"]))
    figures = {"photons per pixel": photons.photons / source.sensor.pixels, "points": len(cloud),
               "latency": f"{summary['latency_median_ms']:.0f} ms"}
    if "dae_mm" in summary:
        figures["mean depth error"] = f"{summary['dae_mm']:.3g} mm"
    draw_overview(path, cloud, source.sensor, photons, source.title, figures)


def _record_film(path: Path, source: Source, probe, rate_hz: float) -> None:
    """Record where the sensor was, and what became of each frame with and without motion, side by side."""
    from srt3d_ros.recording.motion_film import Moment, write_film

    def by_frame(messages: Iterable[bytes], stamped: float) -> dict[int, PointCloud]:
        clouds = [points.decode_cloud(raw, source.sensor) for raw in messages]
        return {_frame_index(cloud, stamped, probe, rate_hz): cloud for cloud in clouds}

    added, moved = by_frame(probe.beside, 0.0), by_frame(probe.kept, source.stamped)
    write_film(path, (Moment(cloud.stamp_ns, source.pose(k), dict(zip(FILM_VIEWS, (added[k], cloud))))
                      for k, cloud in moved.items() if k in added), FILM_VIEWS, FILM_HEIGHTS_M, (0.0, 0.0, 1.0))


def _frame_index(cloud: PointCloud, stamped: float, probe, rate_hz: float) -> int:
    """Which of the player's frames a cloud shows: the player stamps frame k with first stamp + k / rate."""
    return round((cloud.stamp_ns - int(probe.value("player", "first_stamp_ns"))) * 1e-9 * rate_hz - stamped)


def _drops(probe) -> str:
    """Where frames were lost, by the nodes' own frame accounting."""
    found = [f"{node} {key} {value}" for node, values in probe.statuses.items() for key, value in values.items()
             if (key.startswith("dropped.") or key in ("message_lost", "unanswered")) and value != "0"]
    return ", ".join(found) or "no node says where"


def _say(text: str) -> None:
    print(text, flush=True)
