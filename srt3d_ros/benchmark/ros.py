"""Through ROS 2: real nodes in real processes, from a photon frame's stamp to the cloud that arrives.

A player sends one frame again and again, at rising rates; the sketcher and the reconstructor take the newest and drop
what they cannot keep up with, as they do for a sensor. A subscriber in this process, which shares the cores with them,
notes when each cloud comes.
"""

import importlib.util
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from srt3d_ros.benchmark import frames
from srt3d_ros.benchmark.plan import PartFailed, Plan
from srt3d_ros.benchmark.progress import Progress
from srt3d_ros.datasets import npz
from srt3d_ros.evaluation.table import aligned

TITLE = "Through ROS 2: player, sketcher and reconstructor in processes of their own, m = 10"
PPP, SKETCH_SIZE = 10.0, 10
FIRST_HZ, LEAST_HZ, MOST_HZ = 10.0, 1.0, 5120.0
TRIES = 2               # of a rate: one lost frame may be the machine's fault
KEEPS_UP = 0.95         # of the rate asked for: less, and the player itself is too slow
PIPELINE = ("reconstructor", "sketcher")
PLAYER_TIMEOUT_S = 30.0     # beyond the time that it plays
LAST_CLOUD_S = 1.0      # of silence after the player is done: no more will come
HEADINGS = ("Hz asked for", "clouds/s", "frames", "lost", "latency, ms: median", "95 %", "max", "")


def steps(plan: Plan) -> int:
    """By how much the bar moves: about, since it depends on what is found."""
    return 6 + plan.rate_steps


def measure(plan: Plan, bar: Progress, note) -> Iterator[dict]:
    """A line for each rate that was tried, then the highest without loss."""
    absent = [name for name in ("rclpy", "numba") if importlib.util.find_spec(name) is None]
    if absent:
        note(f"left out: {' and '.join(absent)} not installed")
        return
    from srt3d_ros.processes import Processes, join_private_network
    join_private_network()
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    folder = Path(tempfile.mkdtemp(prefix="srt3d-benchmark-"))
    bar.says("starting the nodes")
    sensor = frames.sensor_of(plan.side)
    photons = frames.photons_of(sensor, PPP)
    npz.save(folder / "frame.npz", sensor, photons)
    common = {"rows": sensor.rows, "cols": sensor.cols, "ppp": PPP, "photons": photons.photons,
              "sketch_size": SKETCH_SIZE, "device": plan.device}
    failed = False
    try:
        with PipelineProbe(keep_every=10**9) as monitor, Processes(monitor.spin_until, folder / "logs") as nodes:
            pipeline = Pipeline(monitor, nodes, str(folder / "frame.npz"), plan.rate_s, bar)
            pipeline.start(plan.device)
            tried: list[dict] = []
            for line in search(pipeline.play, plan.rate_steps):
                tried.append(line)
                yield {"what": "rate", **common, **line}
            yield {"what": "highest rate", **common, **highest(tried)}
    except PartFailed:
        failed = True
        raise
    finally:
        if not failed:          # or their logs tell more
            shutil.rmtree(folder)


class Pipeline:
    """Running nodes, and what is seen of a player that plays to them.

    Args:
        monitor, nodes: what sees the clouds, and what starts the player.
        path: the photon file to play.
        seconds: to play for, at least.
        bar: moves by one for each rate.
    """

    def __init__(self, monitor, nodes, path: str, seconds: float, bar: Progress):
        self._monitor, self._nodes, self._path, self._seconds, self._bar = monitor, nodes, path, seconds, bar

    def start(self, device: str) -> None:
        """Start the nodes and let them learn of the sensor, for which they compile once more."""
        self._nodes.start("reconstructor", device=device)
        self._nodes.start("sketcher", sketch_size=SKETCH_SIZE)
        problems = self._nodes.not_ready(PIPELINE, self._monitor.statuses)
        if problems:
            raise PartFailed(problems)
        self.play(FIRST_HZ)

    def play(self, rate_hz: float) -> dict:
        """Play at a rate; what came of it."""
        monitor, nodes = self._monitor, self._nodes
        self._bar.says(f"{rate_hz:.1f} Hz")
        sent, first = int(np.ceil(rate_hz * self._seconds)), len(monitor.arrivals)
        nodes.start("player", input=self._path, rate_hz=float(rate_hz), frames=sent)
        monitor.spin_until(lambda: nodes.ended("player") or nodes.failed(), self._seconds + PLAYER_TIMEOUT_S)
        if nodes.failed() or not nodes.ended("player"):
            raise PartFailed(nodes.failed() or ["the player did not end"])
        before = -1
        while len(monitor.arrivals) - first < sent and before < len(monitor.arrivals):
            before = len(monitor.arrivals)
            monitor.spin_until(lambda: len(monitor.arrivals) > before, LAST_CLOUD_S)
        self._bar.update()
        return outcome(rate_hz, sent, monitor.arrivals[first:])


def outcome(rate_hz: float, sent: int, arrivals: Sequence) -> dict:
    """The figures of a rate, from the clouds that came."""
    line = {"rate_hz": round(rate_hz, 2), "frames_sent": sent, "frames_lost": sent - len(arrivals), "clouds_per_s": 0.0,
            "latency_ms": None}
    if len(arrivals) > 1:
        elapsed_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
        line["clouds_per_s"] = round((len(arrivals) - 1) / max(elapsed_s, 1e-9), 2)
        latencies_ms = [arrival.latency_ms for arrival in arrivals]
        line["latency_ms"] = {"min": round(min(latencies_ms), 2), "median": round(float(np.median(latencies_ms)), 2),
                              "p95": round(float(np.percentile(latencies_ms, 95)), 2),
                              "max": round(max(latencies_ms), 2)}
    return line


def kept_up(line: dict) -> bool:
    """Whether no frame was lost, and as many came as were asked for."""
    return line["frames_lost"] == 0 and line["clouds_per_s"] >= KEEPS_UP * line["rate_hz"]


def search(play: Callable[[float], dict], bisections: int) -> Iterator[dict]:
    """Double the rate until frames are lost, or halve it until none are, and bisect between; yields what was tried."""
    def tried(rate_hz: float) -> dict:
        for _ in range(TRIES):
            line = play(rate_hz)
            if kept_up(line):
                break
        return line

    rate_hz, good, bad = FIRST_HZ, None, None
    while good is None or bad is None:
        line = tried(rate_hz)
        yield line
        if kept_up(line):
            good, rate_hz = rate_hz, 2 * rate_hz
        else:
            bad, rate_hz = rate_hz, rate_hz / 2
        if not LEAST_HZ <= rate_hz <= MOST_HZ:
            return
    for _ in range(bisections):
        rate_hz = float(np.sqrt(good * bad))
        line = tried(rate_hz)
        yield line
        good, bad = (rate_hz, bad) if kept_up(line) else (good, rate_hz)


def highest(lines: Sequence[dict]) -> dict:
    """The fastest of the rates without loss; a rate of 0 if there is none."""
    good = [line for line in lines if kept_up(line)]
    return max(good, key=lambda line: line["rate_hz"]) if good else {"rate_hz": 0.0}


def table(lines: Sequence[dict]) -> str:
    """For people: the rates in order, then the highest."""
    rates = sorted((line for line in lines if line["what"] == "rate"), key=lambda line: line["rate_hz"])
    text = aligned([HEADINGS, *(_cells(line) for line in rates)]) if rates else ""
    for line in lines:
        if line["what"] == "highest rate":
            text += f"\nHighest rate without loss: {line['rate_hz']:.3g} Hz ({line['rows']} × {line['cols']} pixels, " \
                    f"{line['ppp']:g} photons per pixel)."
    return text


def _cells(line: dict) -> list[str]:
    latency = line["latency_ms"] or {}
    return [f"{line['rate_hz']:.3g}", f"{line['clouds_per_s']:.3g}", str(line["frames_sent"]), str(line["frames_lost"]),
            *(f"{latency[name]:.1f}" if latency else "–" for name in ("median", "p95", "max")),
            "" if kept_up(line) else "too fast"]
