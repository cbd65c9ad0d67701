"""What recording costs, and what a recording weighs, with real nodes in real processes; one line for each case.

small: 141 × 141 pixels at 30 Hz through sketcher and reconstructor, some 20,000 points a cloud. large: clouds of
500,000 points at 5 Hz with their images and sketches, prepared beforehand, in the place of a reconstructor on a GPU.
Both run with the recorder at rest and recording in turn, five times each: `after_frame_ms`, from the end of a frame's
acquisition to a cloud's arrival here, and `reconstruct_ms` are the median with over the median without. Then
`--seconds` are recorded, and the recording is read back. kill: a recorder of the small case is killed at 20 random
moments; how much is lost, and that all of it opens after repair.
"""

import argparse
import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import trange

from benchmarks.pipeline import DrivenPipeline, cpu_s, driven_pipeline, write_packet, write_photons
from srt3d_ros.benchmark.frames import photons_of, sensor_of
from srt3d_ros.benchmark.timing import status_bytes
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import images as image_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message

PPP, SKETCH_SIZE = 15.0, 10
SMALL, LARGE, RATES_HZ = 141, 708, {"small": 30.0, "large": 5.0}        # sides of a cloud
TURNS, TURN_S, SETTLE_S, KILLS = 5, 6.0, 3.0, 20
VARIANTS, FOREVER_S = 12, 10_000    # different frames, sent in turn: repeated ones would compress too well
WELL_BEGUN = 3_000_000              # bytes of a file that has clouds
MB = 1e6
CASES = (*RATES_HZ, "kill")
COUNTS = ("frames_in", "frames_out", "dropped", "message_lost", "recording_dropped", "errors")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60.0, help="that are recorded (%(default)g)")
    parser.add_argument("--case", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--turns", type=int, default=TURNS, help="without and with recording (%(default)d)")
    parser.add_argument("--kills", type=int, default=KILLS, help="(%(default)d)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    for case in args.case:
        yield {"case": case} | (kill(args.kills) if case == "kill" else measure(case, args.turns, args.seconds))


def measure(case: str, turns: int, seconds: float) -> dict:
    """Cost and weight of a recording."""
    with started(case) as (pipeline, folder):
        recorder = pipeline.processes["recorder"].pid
        watch(pipeline, case, SETTLE_S)
        turned = {"without": [], "with": []}
        for _ in range(turns):
            turned["without"].append(watch(pipeline, case, TURN_S))
            call(pipeline, "start_recording")
            watch(pipeline, case, SETTLE_S)
            turned["with"].append(watch(pipeline, case, TURN_S))
            call(pipeline, "stop_recording")
            watch(pipeline, case, SETTLE_S)
        call(pipeline, "start_recording")
        watch(pipeline, case, SETTLE_S)
        before_bytes, before_s = status_bytes("VmRSS", Path(f"/proc/{recorder}")), cpu_s(recorder)
        seen = watch(pipeline, case, seconds)
        grown_bytes = status_bytes("VmRSS", Path(f"/proc/{recorder}")) - before_bytes
        used_s = cpu_s(recorder) - before_s
        call(pipeline, "stop_recording")
        watch(pipeline, case, 1.5)          # the last diagnostics
        line = {"seconds": seconds, "clouds_per_s": round(seen["clouds"] / seconds, 2),
                "recorder_memory_growth_mb": round(grown_bytes / MB, 1),
                "recorder_cpu_percent": round(100 * used_s / seconds, 1),
                **{key: pipeline.probe.value("recorder", key) for key in COUNTS}}
        for kind in ("after_frame_ms", "reconstruct_ms")[:1 if case == "large" else 2]:
            line[kind] = compared(*([turn[kind] for turn in turned[name]] for name in ("without", "with")))
        return line | weigh(max(folder.glob("*.rrd"), key=lambda path: path.stat().st_mtime))


def compared(without: list[float], with_: list[float]) -> dict:
    """Medians without and with a recording, and the change."""
    before, after = float(np.median(without)), float(np.median(with_))
    return {"without": round(before, 2), "with": round(after, 2),
            "change_percent": round(100 * (after / before - 1), 1),
            "turns_percent": np.round(100 * (np.array(with_) / np.array(without) - 1), 1).tolist()}


def write_small(folder: Path) -> None:
    """Photons, for a sketcher."""
    simulator = Simulator(sensor=sensor_of(SMALL), ppp=PPP, seed=1)
    write_photons(folder, simulator.sensor, [simulator.frame(k)[0] for k in range(VARIANTS)])


def write_large(folder: Path) -> None:
    """A large cloud with its images, and a sketch of a quarter of its pixels."""
    half, large = sensor_of(LARGE // 2), sensor_of(LARGE)
    frequencies = choose("auto", large, SKETCH_SIZE)
    sketch = sketch_photons(photons_of(half, 4 * PPP), half, frequencies)
    cloud = Pooled(large, frequencies)(sketch_photons(photons_of(large, PPP), large, frequencies))
    images = {"depth": cloud.depth_image(large.projection), "intensity": cloud.image("intensity"),
              "background": cloud.background}
    write_packet(folder, 0, {"sketch": sketch_message.encode_cdr(sketch, "spad"),
                             "points": points_message.encode_cdr(cloud, "spad"),
                             **{name: image_message.encode_cdr(image, 0, "spad") for name, image in images.items()}})
    (folder / "sketch").mkdir()
    (folder / "sketch" / "sensor.json").write_text(sketch_message.encode_sensor(half, frequencies, 1).data)


@contextmanager
def started(case: str) -> Iterator[tuple[DrivenPipeline, Path]]:
    """A recorder at rest, what it is to record, which a driver sends until the pipeline ends, and its folder."""
    nodes = {} if case == "large" else {"reconstructor": {}, "sketcher": {}}
    with (TemporaryDirectory(prefix="srt3d-recording-") as folder,
          driven_pipeline({"recorder": {"path": f"{folder}/recording.rrd", "record": False}} | nodes,
                          write_large if case == "large" else write_small) as pipeline):
        pipeline.processes.run("driver", pipeline.driver_command(f"{RATES_HZ[case]}:{FOREVER_S}"))
        pipeline.probe.wait(lambda: len(pipeline.probe.arrivals) > 20, "clouds", 180)
        yield pipeline, Path(folder)


def watch(pipeline: DrivenPipeline, case: str, seconds: float) -> dict:
    """What happens in so many seconds: clouds, and the latencies of reconstruction and arrival, ms."""
    probe, took_ms = pipeline.probe, []
    first, end = len(probe.arrivals), time.monotonic() + seconds
    while time.monotonic() < end:
        probe.spin_until(lambda: False, 0.25)
        took_ms += filter(None, [float(probe.value("reconstructor", "reconstruct_ms") or 0)])
    latencies_ms = [arrival.latency_ms for arrival in probe.arrivals[first:]]
    return {"clouds": len(latencies_ms), "reconstruct_ms": float(np.median(took_ms or [np.nan])),
            "after_frame_ms": float(np.median(latencies_ms or [np.nan])) - 1e3 / RATES_HZ[case]}


def call(pipeline: DrivenPipeline, service: str) -> None:
    """Call one of the recorder's services."""
    from std_srvs.srv import Trigger
    answer = pipeline.probe.call(Trigger, f"recorder/{service}", Trigger.Request())
    assert answer.success, answer.message


def weigh(path: Path) -> dict:
    """Size, gaps and contents of a recording."""
    from srt3d_ros.recording.reader import RecordingReader
    reader = RecordingReader(path)
    clouds, series = reader.cloud_index(), reader.series()
    size, points = path.stat().st_size, int(clouds.points.sum())
    # A frame with a cloud is in every series, but for those that were in progress at either end.
    inner = set(clouds.stamp_ns[2:-2].tolist())
    gaps = {name: len(inner - set(one.stamp_ns.tolist())) for name, one in series.items() if name != "drops"}
    return {"clouds": len(clouds), "points_per_cloud": points // max(len(clouds), 1), "file_mb": round(size / MB, 1),
            "bytes_per_point": round(size / points, 2), "series": len(series),
            "series_gaps": {name: n for name, n in gaps.items() if n}, "finished": reader.is_finished()}


def kill(times: int) -> dict:
    """Kill the recorder again and again while it records; what is lost, seconds of clouds before the kill."""
    from srt3d_ros.recording.repair import examine, repair
    lost_s, rng = [], random.Random(1)
    with started("small") as (pipeline, folder):
        path = folder / "killed.rrd"
        for _ in trange(times, unit="kill"):
            pipeline.processes.pop("recorder").kill()
            recorder = pipeline.processes.start("recorder", path=path)
            while not (path.exists() and path.stat().st_size > WELL_BEGUN):
                watch(pipeline, "small", 0.2)
            watch(pipeline, "small", SETTLE_S + rng.uniform(0, 2))
            killed_ns = time.time_ns()
            recorder.kill()
            copy = repair(examine(path))
            lost_s.append(lost(copy, pipeline.probe, killed_ns))        # infinite: it had no cloud, for seconds
            copy.unlink()
            path.unlink()
    return {"kills": times, "opened": len(lost_s),
            "lost_s": {"median": round(float(np.median(lost_s)), 3), "most": round(max(lost_s), 3)}}


def lost(path: Path, probe, killed_ns: int) -> float:
    """From the last recorded value of any kind that lacks most to the last cloud that came before the kill, seconds."""
    from srt3d_ros.recording.reader import RecordingReader
    reader = RecordingReader(path)
    series = {name: one for name, one in reader.series().items() if name != "drops"}
    stamps = [reader.cloud_index().stamp_ns, *(one.stamp_ns for one in series.values())]
    if not all(map(len, stamps)):
        return np.inf
    came = max(arrival.stamp_ns for arrival in probe.arrivals if arrival.received_ns <= killed_ns)
    return max(came - min(int(of_one.max()) for of_one in stamps), 0) * 1e-9
