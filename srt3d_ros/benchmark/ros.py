"""Through ROS 2: real nodes in real processes, from a photon frame's stamp to the cloud that arrives.

A player sends one frame again and again, at rising rates; the sketcher and the reconstructor take the newest and drop
what they cannot keep up with, as they do for a sensor. A subscriber in this process, which shares the cores with them,
notes when each cloud comes.
"""

import importlib.util
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from srt3d_ros.benchmark import frames
from srt3d_ros.benchmark.plan import PartFailed, Plan
from srt3d_ros.benchmark.timing import Progress
from srt3d_ros.datasets import npz
from srt3d_ros.evaluation.results import aligned

TITLE = "Through ROS 2: player, sketcher and reconstructor in processes of their own, m = 10"
PPP, SKETCH_SIZE = 10.0, 10
FIRST_HZ, LEAST_HZ, MOST_HZ = 10.0, 1.0, 5120.0
TRIES = 2               # of a rate: one lost frame may be the machine's fault
KEEPS_UP = 0.95         # of the rate asked for: less, and the player itself is too slow
PLAYER_TIMEOUT_S = 30.0     # beyond the time that it plays
LAST_CLOUD_S = 1.0      # of silence after the player is done: no more will come
HEADINGS = ("Hz asked for", "clouds/s", "frames", "lost", "latency, ms: median", "95 %", "max", "")


def measure(plan: Plan, bar: Progress) -> Iterator[dict]:
    """A line for each rate that was tried, then the highest without loss."""
    if importlib.util.find_spec("rclpy") is None:
        bar.note("left out: rclpy is not installed")
        return
    bar.show("starting the nodes")
    sensor = frames.sensor_of(plan.side)
    photons = frames.photons_of(sensor, PPP)
    common = {"rows": sensor.rows, "cols": sensor.cols, "ppp": PPP, "photons": photons.photons,
              "sketch_size": SKETCH_SIZE, "device": plan.device}
    nodes = {"reconstructor": {"device": plan.device}, "sketcher": {"sketch_size": SKETCH_SIZE}}
    with running(nodes) as (probe, processes, folder):
        def play_at(rate_hz: float) -> dict:
            bar.show(f"{rate_hz:.1f} Hz")
            return play(probe, processes, str(folder / "frame.npz"), rate_hz, plan.rate_s)

        npz.save(folder / "frame.npz", sensor, photons)
        play_at(FIRST_HZ)           # the nodes learn of the sensor, for which they compile once more
        tried: list[dict] = []
        for line in search(play_at, plan.rate_steps):
            tried.append(line)
            yield {"what": "rate", **common, **line}
        yield {"what": "highest rate", **common, **highest(tried)}


@contextmanager
def running(nodes: dict[str, dict]) -> Iterator[tuple]:
    """Run these nodes with their parameters, once they are ready; a PipelineProbe, their Processes and a folder.

    The folder is removed at the end, unless a node failed (PartFailed): the logs are in it.
    """
    from srt3d_ros.private_network import join_private_network
    from srt3d_ros.processes import Processes
    join_private_network()
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    folder = Path(tempfile.mkdtemp(prefix="srt3d-benchmark-"))
    failed = False
    try:
        with PipelineProbe(keep_every=10**9) as probe, Processes(probe.spin_until, folder / "logs") as processes:
            for name, parameters in nodes.items():
                processes.start(name, **parameters)
            problems = processes.not_ready(nodes, probe.statuses)
            if problems:
                raise PartFailed(problems)
            yield probe, processes, folder
    except PartFailed:
        failed = True
        raise
    finally:
        if not failed:
            shutil.rmtree(folder)


def play(probe, processes, path: str, rate_hz: float, seconds: float) -> dict:
    """Have a player play a photon file to the running nodes, for at least so long; the figures of this rate."""
    sent, first = int(np.ceil(rate_hz * seconds)), len(probe.arrivals)
    processes.start("player", input=path, rate_hz=float(rate_hz), frames=sent)
    probe.spin_until(lambda: processes.ended("player") or processes.failed(), seconds + PLAYER_TIMEOUT_S)
    if processes.failed() or not processes.ended("player"):
        raise PartFailed(processes.failed() or ["the player did not end"])
    before = -1
    while len(probe.arrivals) - first < sent and before < len(probe.arrivals):
        before = len(probe.arrivals)
        probe.spin_until(lambda: len(probe.arrivals) > before, LAST_CLOUD_S)
    return outcome(rate_hz, sent, probe.arrivals[first:])


def outcome(rate_hz: float, sent: int, arrivals: Sequence) -> dict:
    """The figures of a rate, from the clouds that came."""
    line = {"rate_hz": round(rate_hz, 2), "frames_sent": sent, "frames_lost": sent - len(arrivals), "clouds_per_s": 0.0,
            "latency_ms": None}
    if len(arrivals) > 1:
        elapsed_s = (arrivals[-1].received_ns - arrivals[0].received_ns) * 1e-9
        line["clouds_per_s"] = round((len(arrivals) - 1) / max(elapsed_s, 1e-9), 2)
        least, median, p95, most = np.percentile([arrival.latency_ms for arrival in arrivals], [0, 50, 95, 100])
        line["latency_ms"] = {"min": round(float(least), 2), "median": round(float(median), 2),
                              "p95": round(float(p95), 2), "max": round(float(most), 2)}
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
