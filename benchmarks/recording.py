"""What recording costs, and what a recording weighs, with real nodes in real processes; one JSON line for each case.

    PYTHONPATH=. python benchmarks/recording.py [--seconds 60] [--case small large kill review] [--out FILE]

small: 141 × 141 pixels at 30 Hz through sketcher and reconstructor, some 20,000 points a cloud. large: clouds of
500,000 points at 5 Hz with their images and sketches, from a stand-in for a reconstructor on a GPU, which reconstructs
141 × 141 pixels on the CPU for each of them. Both run with the recorder at rest and recording in turn, five times each:
the latency, of the reconstruction and from the stamp to a cloud's arrival here, is the median with over the median
without. Then `--seconds` are recorded, and the recording is read back. kill: a recorder of the small case is killed at
20 random moments; how much is lost, and that all of it opens after repair. review: how long `srt3d review` takes to
make a report of a recording (`--recording FILE`), such as the five minutes that scripts/attacks/soak.py leaves.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from live import tell, write_messages
from tqdm import trange

from srt3d_ros.benchmark.frames import sensor_of
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.processes import join_private_network, parameter_arguments

PPP = 15.0
CASES = {"small": (141, 30.0), "large": (708, 5.0)}         # side of a cloud, Hz
TURNS, TURN_S, SETTLE_S, KILLS = 5, 6.0, 3.0, 20
VARIANTS, FOREVER_S = 12, 10_000   # different frames, sent in turn: repeated ones would compress too well
WELL_BEGUN = 3_000_000      # bytes of a file that has clouds
MB = 1e6


class Pipeline:
    """Recorder at rest, reconstructor and sketcher, or the stand-in; a context manager that ends them.

    Args:
        case: one of CASES.
        folder: for the photons, the logs and the recordings.
    """

    def __init__(self, case: str, folder: Path):
        from srt3d_ros.nodes.pipeline_probe import PipelineProbe
        self.folder, (side, rate_hz) = folder, CASES[case]
        self.monitor, self.running = PipelineProbe(keep_every=10**9), {}
        self._commands = {"recorder": node("recorder", path=str(folder / "recording.rrd"), record=False)}
        if case == "large":
            self.latency_of = "standin"
            self._commands["standin"] = [str(Path(__file__).with_name("standin.py")), "--side", str(side), "--rate-hz",
                                         str(rate_hz)]
            return
        self.latency_of = "reconstructor"
        simulator = Simulator(sensor=sensor_of(side), ppp=PPP, seed=1)
        topic = write_messages(folder, simulator.sensor, [simulator.frame(k)[0] for k in range(VARIANTS)])
        driver = [str(Path(__file__).with_name("driver.py")), str(folder), topic, f"{rate_hz}:{FOREVER_S}"]
        self._commands |= {"reconstructor": node("reconstructor"), "sketcher": node("sketcher"), "driver": driver}

    def __enter__(self) -> "Pipeline":
        self.monitor.__enter__()
        for name, command in self._commands.items():
            self.start(name, command)
            if name != "driver" and not self.monitor.spin_until(lambda name=name: name in self.monitor.statuses, 180):
                raise SystemExit(f"{name} was not ready: see {self.folder}")
        if not self.monitor.spin_until(lambda: len(self.monitor.arrivals) > 20, 180):
            raise SystemExit(f"no clouds: see {self.folder}")
        return self

    def __exit__(self, *exc) -> None:
        for name, process in reversed(self.running.items()):
            process.send_signal(signal.SIGTERM if name == "driver" else signal.SIGINT)
        for process in self.running.values():
            process.wait(40)
        self.monitor.__exit__()

    def start(self, name: str, command: list[str]) -> None:
        """Start a process: arguments of Python."""
        with (self.folder / f"{name}.log").open("ab") as log:
            self.running[name] = subprocess.Popen([sys.executable, *command], stdout=log, stderr=log)

    def watch(self, seconds: float) -> dict:
        """What happens in so many seconds: clouds, and the latencies of reconstruction and arrival, ms."""
        first, took_ms = len(self.monitor.arrivals), []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.monitor.spin_until(lambda: False, 0.25)
            took_ms.append(float(self.monitor.value(self.latency_of, "reconstruct_ms") or "nan"))
        arrivals = self.monitor.arrivals[first:]
        latencies_ms = [arrival.latency_ms for arrival in arrivals] or [np.nan]
        return {"clouds": len(arrivals), "reconstruct_ms": float(np.nanmedian(took_ms)),
                "arrival_ms": float(np.median(latencies_ms))}

    def call(self, service: str) -> None:
        """Call one of the recorder's services."""
        from std_srvs.srv import Trigger
        client = self.monitor.node.create_client(Trigger, f"recorder/{service}")
        self.monitor.spin_until(client.service_is_ready, 20)
        answer = client.call_async(Trigger.Request())
        self.monitor.spin_until(answer.done, 40)
        assert answer.result().success, answer.result().message
        self.monitor.node.destroy_client(client)

    def rss_mb(self) -> float:
        """Resident memory of the recorder."""
        pages = int(Path(f"/proc/{self.running['recorder'].pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / MB

    def cpu_s(self) -> float:
        """CPU time that the recorder has used."""
        fields = Path(f"/proc/{self.running['recorder'].pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def node(name: str, **parameters) -> list[str]:
    """Arguments of Python that run a node."""
    return ["-m", f"srt3d_ros.nodes.{name}", *parameter_arguments(parameters)]


def measure(case: str, seconds: float, folder: Path) -> dict:
    """Cost and weight of a recording."""
    load = os.getloadavg()[0]
    with Pipeline(case, folder) as pipeline:
        pipeline.watch(SETTLE_S)
        turns = {"without": [], "with": []}
        for _ in range(TURNS):
            turns["without"].append(pipeline.watch(TURN_S))
            pipeline.call("start_recording")
            pipeline.watch(SETTLE_S)
            turns["with"].append(pipeline.watch(TURN_S))
            pipeline.call("stop_recording")
            pipeline.watch(SETTLE_S)
        pipeline.call("start_recording")
        pipeline.watch(SETTLE_S)
        before_mb, before_s = pipeline.rss_mb(), pipeline.cpu_s()
        seen = pipeline.watch(seconds)
        grown_mb, cpu_percent = pipeline.rss_mb() - before_mb, 100 * (pipeline.cpu_s() - before_s) / seconds
        pipeline.call("stop_recording")
        path = max(folder.glob("recording*.rrd"), key=lambda path: path.stat().st_mtime)
        pipeline.watch(1.5)
        accounting = {key: pipeline.monitor.value("recorder", key) for key in
                 ("frames_in", "frames_out", "dropped", "message_lost", "recording_dropped", "errors")}
    line = {"case": case, "seconds": seconds, "clouds_per_s": round(seen["clouds"] / seconds, 2),
            "recorder_memory_growth_mb": round(grown_mb, 1), "recorder_cpu_percent": round(cpu_percent, 1),
            **accounting}
    for kind in ("reconstruct_ms", "arrival_ms"):
        without, with_ = (np.array([turn[kind] for turn in turns[name]]) for name in ("without", "with"))
        line[kind] = {"without": round(float(np.median(without)), 2), "with": round(float(np.median(with_)), 2),
                      "change_percent": round(100 * float(np.median(with_) / np.median(without) - 1), 1),
                      "turns_percent": np.round(100 * (with_ / without - 1), 1).tolist()}
    return line | weigh(path) | {"load_before": round(load, 2), "cores": os.cpu_count()}


def weigh(path: Path) -> dict:
    """Size, gaps and what is there of a recording."""
    from srt3d_ros.recording.reader import RecordingReader
    reader = RecordingReader(path)
    clouds, series = reader.cloud_index(), reader.series()
    size, points = path.stat().st_size, int(clouds.points.sum())
    # A frame with a cloud is in every series, but for those that were under way at either end.
    inner = set(clouds.stamp_ns[2:-2].tolist())
    gaps = {name: len(inner - set(one.stamp_ns.tolist())) for name, one in series.items() if name != "drops"}
    return {"clouds": len(clouds), "points_per_cloud": points // max(len(clouds), 1), "file_mb": round(size / MB, 1),
            "bytes_per_point": round(size / points, 2), "series": len(series),
            "series_gaps": {name: n for name, n in gaps.items() if n}, "finished": reader.is_finished()}


def kill(folder: Path, times: int) -> dict:
    """Kill the recorder again and again while it records; what is lost, seconds of clouds before the kill."""
    from srt3d_ros.recording.repair import examine, repair
    lost_s, rng, path = [], random.Random(1), folder / "killed.rrd"
    with Pipeline("small", folder) as pipeline:
        for _ in trange(times, unit="kill"):
            stop(pipeline.running["recorder"])
            pipeline.start("recorder", node("recorder", path=str(path)))
            while not (path.exists() and path.stat().st_size > WELL_BEGUN):
                pipeline.watch(0.2)
            pipeline.watch(SETTLE_S + rng.uniform(0, 2))
            killed_ns = time.time_ns()
            stop(pipeline.running["recorder"])
            copy = repair(examine(path))
            lost_s.append(lost(copy, pipeline.monitor, killed_ns))      # infinite: it had no cloud, for seconds
            copy.unlink()
            path.unlink()
    return {"case": "kill", "kills": times, "opened": len(lost_s), "lost_s": {
        "median": round(float(np.median(lost_s)), 3), "most": round(max(lost_s), 3)}, "cores": os.cpu_count()}


def review(path: Path, folder: Path) -> dict:
    """Time a report."""
    from srt3d_ros.recording.reader import RecordingReader
    clouds = RecordingReader(path).cloud_index()
    minutes = (int(clouds.stamp_ns[-1]) - int(clouds.stamp_ns[0])) / 60e9
    load, began_s = os.getloadavg()[0], time.monotonic()
    subprocess.run([sys.executable, "-m", "srt3d_ros.cli.main", "review", str(path), "-o",
                    str(folder / "report.html")], check=True, stdout=subprocess.DEVNULL)
    return {"case": "review", "took_s": round(time.monotonic() - began_s, 2), "minutes": round(minutes, 2),
            "clouds": len(clouds), "file_mb": round(path.stat().st_size / MB, 1),
            "report_mb": round((folder / "report.html").stat().st_size / MB, 2), "load_before": round(load, 2),
            "cores": os.cpu_count()}


def stop(process: subprocess.Popen) -> None:
    """kill -9, and wait."""
    process.kill()
    process.wait()


def lost(path: Path, monitor, killed_ns: int) -> float:
    """From the last recorded value of any kind that lacks most to the last cloud that came before the kill, seconds."""
    from srt3d_ros.recording.reader import RecordingReader
    reader = RecordingReader(path)
    series = {name: one for name, one in reader.series().items() if name != "drops"}
    stamps = [reader.cloud_index().stamp_ns, *(one.stamp_ns for one in series.values())]
    if not all(map(len, stamps)):
        return np.inf
    last = [int(of_one.max()) for of_one in stamps]
    came = max(arrival.stamp_ns for arrival in monitor.arrivals if arrival.received_ns <= killed_ns)
    return max(came - min(last), 0) * 1e-9


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--case", nargs="+", choices=(*CASES, "kill", "review"), default=[*CASES, "kill"])
    parser.add_argument("--kills", type=int, default=KILLS)
    parser.add_argument("--recording", type=Path, help="to review")
    parser.add_argument("--out", type=Path, help="append the lines to this file, too")
    args = parser.parse_args()
    if "review" in args.case and args.recording is None:
        parser.error("the case review needs --recording FILE")
    join_private_network()
    for case in args.case:
        folder = Path(tempfile.mkdtemp(prefix="srt3d-recording-"))
        if case == "review":
            line = review(args.recording, folder)
        else:
            line = kill(folder, args.kills) if case == "kill" else measure(case, args.seconds, folder)
        shutil.rmtree(folder)
        tell(line, args.out)


if __name__ == "__main__":
    main()
