"""Five times the photons that the machine can take, for a while: what is dropped, and how soon all is well again.

141 × 141 pixels with 10 photons each. First the rate is found that the machine can take: what comes out when too much
goes in. Then half of that rate, five times that rate, and half of it again are sent. Latency counts from where a
frame's acquisition ends; `unaccounted` are frames that neither came out nor were counted as dropped anywhere;
`recovery_s` is when, after the overload, a second began in which nothing was lost and latency was as before it.
The picture shows rates, latency and drops by cause over time.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.pipeline import driven_pipeline, losses, percentiles, write_photons
from srt3d_ros.benchmark.frames import photons_of, sensor_of
from srt3d_ros.pictures.png import save_png

SIDE, PPP, TIMES = 141, 10.0, 5
PROBE_HZ, PROBE_S, NORMAL_S = 60, 5, 6
PERIODS = 3                             # of the rate that the machine can take: what a frame may wait
NORMAL = 1.5                            # times the latency (95 %) before: as before
BIN_S = 0.5
SENT, CAME, BOUND = "#0072b2", "#009e73", "#d55e00"
CAUSES = ("#d55e00", "#e69f00", "#cc79a7", "#56b4e9", "#000000")        # any colour vision (Okabe and Ito, 2008)


@dataclass
class Run:
    """What was seen of the three phases; times are in seconds after the first one began.

    Args:
        phases: of the driver.
        due_s: of the clouds, when their frame was sent.
        latency_ms: of the same clouds.
        history: time, losses so far, ms that the last reconstruction took.
    """

    capacity_hz: float
    phases: list[dict]
    due_s: np.ndarray
    latency_ms: np.ndarray
    history: list[tuple[float, dict[str, int], float]]

    @property
    def edges_s(self) -> list[float]:
        """Where phases begin and the last one ends."""
        edges_ns = [phase["began_ns"] for phase in self.phases] + [self.phases[-1]["ended_ns"]]
        return [(edge_ns - edges_ns[0]) * 1e-9 for edge_ns in edges_ns]

    def latencies_ms(self, phase: int) -> np.ndarray:
        """Of the clouds of a phase."""
        first_s, last_s = self.edges_s[phase:phase + 2]
        return self.latency_ms[(self.due_s >= first_s - 1e-6) & (self.due_s < last_s - 1e-6)]

    @property
    def reconstruct_ms(self) -> float:
        """What a reconstruction takes during the overload."""
        first_s, last_s = self.edges_s[1:3]
        return float(np.median([ms for at_s, _, ms in self.history if first_s + 1 < at_s < last_s] or [np.nan]))

    @property
    def bound_ms(self) -> float:
        """What a frame may take during the overload."""
        return PERIODS * 1e3 / self.capacity_hz + self.reconstruct_ms

    @property
    def recovery_s(self) -> float:
        """After the overload, when a second began in which all was as before; infinite if none did."""
        phase, interval_s = self.phases[2], 1 / self.phases[2]["rate_hz"]
        normal_ms = NORMAL * np.percentile(self.latencies_ms(0), 95)
        fine = [bool(((abs(self.due_s - due_s) < interval_s / 4) & (self.latency_ms < normal_ms)).any())
                for due_s in self.edges_s[2] + interval_s * np.arange(phase["sent"])]
        frames = max(round(phase["rate_hz"]), 1)
        return next((k * interval_s for k in range(len(fine) - frames) if all(fine[k:k + frames])), float("inf"))

    @property
    def dropped(self) -> dict[str, int]:
        """Frames, by NODE.CAUSE."""
        return {key: n for key, n in self.history[-1][1].items()
                if n and key.split(".")[-1] not in ("dropped", "errors")}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=10.0, help="of overload (%(default)g)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="such as docs/images/overload.png")


def run(args: argparse.Namespace) -> Iterator[dict]:
    seen, cpu = measure(args.seconds)
    sent = sum(phase["sent"] for phase in seen.phases)
    yield {"capacity_hz": round(seen.capacity_hz, 1), "rates_hz": [phase["rate_hz"] for phase in seen.phases],
           "sent": sent, "skipped_by_driver": sum(phase["skipped"] for phase in seen.phases),
           "clouds": len(seen.due_s), "dropped": seen.dropped,
           "unaccounted": sent - len(seen.due_s) - sum(seen.dropped.values()),
           "normal_ms": percentiles(seen.latencies_ms(0)), "overload_ms": percentiles(seen.latencies_ms(1)),
           "reconstruct_ms": round(seen.reconstruct_ms, 1), "bound_ms": round(seen.bound_ms, 1),
           "recovery_s": round(seen.recovery_s, 2), "cpu_percent": cpu}
    if args.picture:
        draw(seen, args.picture)


def measure(seconds: float) -> tuple[Run, dict[str, float]]:
    """What was seen, and the CPU of each process in %."""
    sensor = sensor_of(SIDE)
    frame = photons_of(sensor, PPP)
    nodes = {"reconstructor": {}, "sketcher": {}}
    with driven_pipeline(nodes, lambda folder: write_photons(folder, sensor, [frame])) as pipeline:
        probe = pipeline.probe
        pipeline.drive("10:2")                          # compiles for the sensor
        first = len(probe.arrivals)
        pipeline.drive(f"{PROBE_HZ}:{PROBE_S}")
        capacity_hz = max((len(probe.arrivals) - first) / PROBE_S, 2.0)
        first, before, history = len(probe.arrivals), losses(probe), []

        def watch() -> None:
            history.append((time.time_ns(), losses(probe),
                            float(probe.value("reconstructor", "reconstruct_ms") or "nan")))

        normal = f"{capacity_hz / 2:.2f}:{NORMAL_S}"
        phases, cpu = pipeline.drive(f"{normal},{TIMES * capacity_hz:.2f}:{seconds},{normal}", watch)
        watch()
        arrivals = probe.arrivals[first:]
    interval_ns, first_ns = round(1e9 / phases[0]["rate_hz"]), phases[0]["began_ns"]
    due_s = np.array([arrival.stamp_ns + interval_ns - first_ns for arrival in arrivals]) * 1e-9
    latency_ms = np.array([arrival.latency_ms for arrival in arrivals]) - interval_ns * 1e-6
    return Run(capacity_hz, phases, due_s, latency_ms, [
        ((at_ns - first_ns) * 1e-9, {key: n - before.get(key, 0) for key, n in now.items()}, ms)
        for at_ns, now, ms in history]), cpu


def draw(seen: Run, path: Path) -> None:
    """Rates, latency and drops over time."""
    figure = Figure(figsize=(10, 8), dpi=100, layout="constrained")
    rates, latency, drops = figure.subplots(3, 1, sharex=True)
    edges_s = seen.edges_s
    rates.stairs([phase["rate_hz"] for phase in seen.phases], edges_s, baseline=None, color=SENT, linewidth=2,
                 label="frames sent")
    bins_s = np.arange(0, edges_s[-1] + 2, BIN_S)
    came, _ = np.histogram(seen.due_s + seen.latency_ms * 1e-3, bins_s)
    rates.stairs(came / BIN_S, bins_s, baseline=None, color=CAME, linewidth=2, label="clouds that came")
    rates.set(ylabel="per second", title=f"{SIDE} × {SIDE} pixels: {TIMES} times what {os.cpu_count()} cores can take")
    latency.plot(seen.due_s, seen.latency_ms, ".", color=SENT, markersize=4, label="of each cloud")
    latency.axhline(seen.bound_ms, color=BOUND, linestyle="--", linewidth=1,
                    label=f"{PERIODS} frame periods and a reconstruction")
    latency.set(ylabel="latency, ms", ylim=(0, None))
    times_s = [at_s for at_s, _, _ in seen.history]
    for colour, cause in zip(CAUSES, sorted(seen.dropped)):
        drops.step(times_s, [counted.get(cause, 0) for _, counted, _ in seen.history], where="post", color=colour,
                   linewidth=2, label=cause.replace(".dropped.", ": ").replace(".message_lost", ": lost on the way"))
    drops.set(xlabel="time, s", ylabel="frames dropped, by cause", xlim=(0, edges_s[-1] + 1))
    for panel in (rates, latency, drops):
        panel.axvspan(edges_s[1], edges_s[2], color="#f4efe6", zorder=0)
        panel.grid(color="#d9dce0", linewidth=0.6)
        panel.legend(frameon=False, fontsize=9, loc="upper left" if panel is drops else "upper right")
    save_png(figure, path)
