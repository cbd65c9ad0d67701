"""A link of 100 Mbit/s that falls to 10 and rises again: age and quality of sketches with max_mbit_s and without.

A moving head of 141 × 141 pixels, m = 10, goes through player and sketcher on one machine to a reader on the other that
keeps the sketches (machines.py: needs root and iproute2). They are reconstructed afterwards, as the node would; errors
are those from the true scene at the stamp of each sketch.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.machines import NETWORK_PROFILE, SENSOR, Link, Machines, Watch, why_not
from benchmarks.pipeline import percentiles
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import default_sensor
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message

PHASES = ((8.0, 100.0), (15.0, 10.0), (17.0, 100.0))        # s, Mbit/s
RATE_HZ, PPP, SBR, LIMIT_MBIT_S = 30.0, 10.0, 1.0, 80.0
SKETCH_SIZE = 10
SCENE_FRAMES = 60           # drawn; played forwards and, drawn anew, backwards
SAMPLE_S = 0.1
OLD_MS = 500
WITHIN_M = 3e-3             # 10 bins: a point that is right
STYLES = {LIMIT_MBIT_S: ("#d55e00", "o", f"max_mbit_s {LIMIT_MBIT_S:g}"), 0.0: ("#6b7280", "x", "no max_mbit_s")}
COLUMNS = ("t", "age_ms", "bytes", "step", "frames", "dae_mm", "right")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--picture", type=Path, default=Path("docs/images/degrade.png"), help="(%(default)s)")
    parser.add_argument("--rate-hz", type=float, default=RATE_HZ, help="of the frames (%(default)g)")


def run(args: argparse.Namespace) -> Iterator[dict]:
    if reason := why_not():
        sys.exit(f"no link can be made here: {reason}")
    with tempfile.TemporaryDirectory(prefix="srt3d-degrade-") as folder:
        bag, truth_m = write_bag(Path(folder))
        series = {limit: play(Path(folder), bag, truth_m, args.rate_hz, limit) for limit in STYLES}
    for limit, of_limit in series.items():
        for phase in summary(of_limit):
            yield {"max_mbit_s": limit, "rate_hz": args.rate_hz, **phase}
    draw(args.picture, series)


def write_bag(folder: Path) -> tuple[Path, list[np.ndarray]]:
    """A bag of the moving scene, and the true ranges [rows, cols] of each of its frames, metres."""
    sensor, path, truth_m = default_sensor(), folder / "scene", []
    writer = BagWriter(path)
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer(durability="transient_local")])
    writer.add_topic("/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.write("/sensor", 10**9, sensor_message.encode_cdr(sensor))
    simulators = [Simulator(sensor=sensor, sbr=SBR, ppp=PPP, seed=seed, frame_rate_hz=RATE_HZ) for seed in (0, 1)]
    for k in range(2 * SCENE_FRAMES):
        back, at = divmod(k, SCENE_FRAMES)
        frame, depth = simulators[back].frame(SCENE_FRAMES - 1 - at if back else at)
        stamp_ns = 10**9 + round(k * 1e9 / RATE_HZ)
        frame = type(frame)(frame.pixel, frame.toa, stamp_ns)
        writer.write("/photons", stamp_ns, photons_message.encode_cdr(frame, sensor, "spad"))
        truth_m.append(sensor.range_m(depth[0]))
    writer.close()
    return path, truth_m


def play(folder: Path, bag: Path, truth_m: list[np.ndarray], rate_hz: float, limit: float) -> dict[str, np.ndarray]:
    """Play the bag over the link; columns of the sketches that arrived (`judged`) and of samples in time."""
    kept, samples = folder / f"sketches-{limit:g}", []
    kept.mkdir()
    frequencies = choose("auto", default_sensor(), SKETCH_SIZE)
    with Link(PHASES[0][1]) as link, Machines(link, folder) as machines:
        watch = machines.watch("sketch", keep=kept)
        machines.start_on(SENSOR, "sketcher", NETWORK_PROFILE, layout="coded", max_mbit_s=limit,
                          frequencies=",".join(map(str, frequencies)))
        machines.wait(lambda: "sketcher" in watch.reports, "the sketcher")
        machines.start_on(SENSOR, "player", input=str(bag), bag_loop=True, bag_stamps="now", bag_rate=rate_hz / RATE_HZ)
        machines.wait(lambda: watch.arrivals, "the first sketch")
        began_s, began_ns = time.monotonic(), watch.arrivals[0].stamp_ns
        ends_s, carried = np.cumsum([seconds for seconds, _ in PHASES]), PHASES[0][1]
        while (t := time.monotonic() - began_s) < ends_s[-1]:
            wanted = PHASES[int(np.searchsorted(ends_s, t))][1]
            if wanted != carried:
                link.carry(carried := wanted)
            samples.append((t, carried, link.wire_bytes()))
            time.sleep(SAMPLE_S)
    return {**dict(zip(("time_s", "link_mbit_s", "wire_bytes"), np.array(samples).T)),
            **judged(watch, began_ns, kept, frequencies, truth_m, rate_hz)}


def judged(watch: Watch, began_ns: int, folder: Path, frequencies: tuple[int, ...], truth_m: list[np.ndarray],
           rate_hz: float) -> dict[str, np.ndarray]:
    """Of each sketch: when it arrived, its age, step, frames; and of its cloud the mean error of right points, share.

    The reconstructor of this process has no link before it: what is measured here does not wait for it.
    """
    rows, sensor = [], default_sensor()
    reconstruct, one_frame = Pooled(sensor, frequencies), PPP * sensor.pixels
    for arrival in watch.arrivals:
        raw = (folder / str(arrival.stamp_ns)).read_bytes()
        _, sketch = sketch_message.decode_cdr(raw, frequencies, sensor)
        cloud = reconstruct(sketch)
        frame = round((arrival.stamp_ns - began_ns) * 1e-9 * rate_hz) % len(truth_m)
        error = np.abs(np.linalg.norm(cloud.xyz, axis=1) - truth_m[frame][cloud.row, cloud.col])
        right = error[error < WITHIN_M]
        rows.append(((arrival.received_ns - began_ns) * 1e-9, arrival.latency_ms, len(raw),
                     np.sqrt(12 * sketch.added_variance), round(sketch.photons.sum() / one_frame),
                     right.mean() * 1e3, 100 * len(right) / sensor.pixels))
    return dict(zip(COLUMNS, np.array(rows).T))


def summary(series: dict[str, np.ndarray]) -> Iterator[dict]:
    """What came of each phase."""
    begins_s = 0.0
    for seconds, mbit_s in PHASES:
        ends_s = begins_s + seconds
        arrived = (series["t"] >= begins_s) & (series["t"] < ends_s)
        at = (series["time_s"] >= begins_s) & (series["time_s"] < ends_s)
        wire = np.ptp(series["wire_bytes"][at]) * 8e-6 / seconds
        yield {"link_mbit_s": mbit_s, "seconds": seconds, "wire_mbit_s": round(wire, 1),
               "sketches": int(arrived.sum()), "frames": int(series["frames"][arrived].sum()),
               "age_ms": percentiles(series["age_ms"][arrived]),
               "dae_mm": _mean(series["dae_mm"][arrived]), "right_percent": _mean(series["right"][arrived]),
               "coding_step": _mean(series["step"][arrived])}
        begins_s = ends_s


def _mean(values: np.ndarray) -> float:
    return round(float(np.mean(values)), 3) if len(values) else float("nan")


def draw(path: Path, series: dict[float, dict[str, np.ndarray]]) -> None:
    """Age, step, frames merged and depth error of each sketch against time; and error against rate."""
    figure = Figure(figsize=(11, 8), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(4, 2, width_ratios=(2.2, 1))
    left = [figure.add_subplot(grid[row, 0]) for row in range(4)]
    right = figure.add_subplot(grid[:2, 1]), figure.add_subplot(grid[2:, 1])
    for limit, of_limit in series.items():
        colour, marker, name = STYLES[limit]
        for panel, column in zip(left, ("age_ms", "step", "frames", "dae_mm")):
            panel.plot(of_limit["t"], of_limit[column], marker, color=colour, markersize=3, label=name)
        rates = of_limit["bytes"] * 8e-6 * _sketches_a_second(of_limit["t"])
        for panel, column in zip(right, ("dae_mm", "right")):
            panel.plot(rates, of_limit[column], marker, color=colour, markersize=3, alpha=0.5)
    for panel in left:
        ends_s = np.cumsum([0.0, *(seconds for seconds, _ in PHASES)])
        panel.axvspan(ends_s[1], ends_s[2], color="#f1f2f4", zorder=0)
        panel.set_xlim(0, ends_s[-1])
        panel.sharex(left[0])
    for label, panel in zip(("age on arrival, ms", "coding step, σ", "frames in a sketch", "depth error, mm"), left):
        panel.set_ylabel(label)
    left[0].axhline(OLD_MS, color="black", linewidth=1, linestyle=":")
    left[0].set_yscale("log")
    left[0].set_yticks([20, 50, 100, 200, OLD_MS, 1000], labels=["20", "50", "100", "200", "500", "1000"])
    left[0].minorticks_off()
    left[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=2, markerscale=2)
    for begins_s, (_, mbit_s) in zip(ends_s, PHASES):
        left[1].annotate(f"link: {mbit_s:g} Mbit/s", (begins_s + 0.3, 0.1))
    left[1].set_ylim(0, None)
    left[2].set_ylim(0, None)
    left[3].set_xlabel("s")
    right[0].set(ylabel="depth error, mm", title="quality against rate")
    right[1].set(ylabel="pixels right within 3 mm, %", xlabel="Mbit/s of sketches, over 1 s")
    for panel in (*left, *right):
        panel.grid(color="#d9dce0", linewidth=0.6)
    figure.savefig(path)


def _sketches_a_second(t: np.ndarray) -> np.ndarray:
    """Of each time, how many are within half a second of it."""
    return np.array([np.count_nonzero(np.abs(t - at) < 0.5) for at in t])
