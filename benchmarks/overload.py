"""Five times the photons that the machine can take, for a while: what is dropped, and how soon all is well again.

    PYTHONPATH=. python benchmarks/overload.py [--seconds 10] [--out FILE] [--picture docs/images/overload.png]

141 × 141 pixels with 10 photons each. First the rate is found that the machine can take: what comes out when too much
goes in. Then half of that rate, five times that rate, and half of it again are sent. One JSON line: latency counts from
where a frame's acquisition ends; `unaccounted` are frames that neither came out nor were counted as dropped anywhere;
`recovery_s` is when, after the overload, a second began in which nothing was lost and latency was as before it.
The picture shows rates, latency and drops by cause over time.
"""

import argparse
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from live import Pipeline, accounting, percentiles, tell
from matplotlib.figure import Figure

from srt3d_ros.benchmark.frames import photons_of, sensor_of
from srt3d_ros.pictures.png import save_png
from srt3d_ros.processes import join_private_network

SIDE, PPP, TIMES = 141, 10.0, 5
PROBE_HZ, PROBE_S, CALM_S = 60, 5, 6
PERIODS = 3                             # of the rate that the machine can take: what a frame may wait
NORMAL = 1.5                            # times the latency (95 %) before: as before
BIN_S = 0.5
SENT, CAME, BOUND = "#0072b2", "#009e73", "#d55e00"
CAUSES = ("#d55e00", "#e69f00", "#cc79a7", "#56b4e9", "#000000")        # any colour vision (Okabe and Ito, 2008)


@dataclass
class Run:
    """What was seen of the three phases."""

    capacity_hz: float
    phases: list[dict]
    due_s: np.ndarray           # of the clouds: when their frame was sent, after the first phase began
    latency_ms: np.ndarray      # of the same clouds
    history: list[tuple[float, dict[str, int], float]]      # time, accounting, ms that the last reconstruction took

    @property
    def edges_s(self) -> list[float]:
        """Where phases begin and the last one ends."""
        first_ns = self.phases[0]["began_ns"]
        return [(phase["began_ns"] - first_ns) * 1e-9 for phase in self.phases] + [
            (self.phases[-1]["ended_ns"] - first_ns) * 1e-9]

    def of_phase(self, k: int) -> np.ndarray:
        """Which clouds are of a phase."""
        first_s, last_s = self.edges_s[k:k + 2]
        return (self.due_s >= first_s - 1e-6) & (self.due_s < last_s - 1e-6)

    @property
    def reconstruct_ms(self) -> float:
        """What a reconstruction takes during the overload."""
        first_s, last_s = self.edges_s[1:3]
        return float(np.median([ms for at_s, _, ms in self.history if first_s + 1 < at_s < last_s] or [np.nan]))

    @property
    def recovery_s(self) -> float:
        """After the overload, when a second began in which all was as before; infinite if none did."""
        phase, start_s = self.phases[2], self.edges_s[2]
        normal_ms = NORMAL * np.percentile(self.latency_ms[self.of_phase(0)], 95)
        interval_s = 1 / phase["rate_hz"]
        fine = [bool(((abs(self.due_s - due_s) < interval_s / 4) & (self.latency_ms < normal_ms)).any())
                for due_s in start_s + interval_s * np.arange(phase["sent"])]
        frames = max(round(phase["rate_hz"]), 1)
        return next((k * interval_s for k in range(len(fine) - frames) if all(fine[k:k + frames])), float("inf"))


def measure(seconds: float) -> tuple[dict, Run]:
    """The figures, and what they come from."""
    from srt3d_ros.nodes.pipeline_probe import PipelineProbe
    sensor, load = sensor_of(SIDE), os.getloadavg()[0]
    with PipelineProbe(keep_every=10**9) as monitor, Pipeline(monitor, sensor, [photons_of(sensor, PPP)]) as pipeline:
        pipeline.drive("10:2")                          # compiles for the sensor
        before = len(monitor.arrivals)
        pipeline.drive(f"{PROBE_HZ}:{PROBE_S}")
        capacity_hz = max((len(monitor.arrivals) - before) / PROBE_S, 2.0)
        calm, first = f"{capacity_hz / 2:.2f}:{CALM_S}", len(monitor.arrivals)
        counted, history = accounting(monitor), []
        said, cpu = pipeline.drive(
            f"{calm},{TIMES * capacity_hz:.2f}:{seconds},{calm}",
            lambda: history.append((time.time_ns(), accounting(monitor),
                                    float(monitor.value("reconstructor", "reconstruct_ms") or "nan"))))
        history.append((time.time_ns(), accounting(monitor), float("nan")))
    phases, arrivals = said["phases"], monitor.arrivals[first:]
    interval_ns, first_ns = round(1e9 / phases[0]["rate_hz"]), phases[0]["began_ns"]
    due_s = np.array([arrival.stamp_ns + interval_ns - first_ns for arrival in arrivals]) * 1e-9
    changed = [((at_ns - first_ns) * 1e-9, {key: n - counted.get(key, 0) for key, n in now.items()}, ms)
               for at_ns, now, ms in history]
    run = Run(capacity_hz, phases, due_s, np.array([arrival.latency_ms for arrival in arrivals]) - interval_ns * 1e-6,
              changed)
    return {**figures(run), "cpu_percent": cpu, "load_before": load, "cores": os.cpu_count()}, run


def figures(run: Run) -> dict:
    """The line that is printed."""
    last = run.history[-1][1]
    dropped = {key: n for key, n in last.items() if n and key.split(".")[-1] not in ("dropped", "errors")}
    sent = sum(phase["sent"] for phase in run.phases)
    latency = percentiles(run.latency_ms[run.of_phase(1)])
    return {"capacity_hz": round(run.capacity_hz, 1), "rates_hz": [phase["rate_hz"] for phase in run.phases],
            "sent": sent, "skipped_by_driver": sum(phase["skipped"] for phase in run.phases), "clouds": len(run.due_s),
            "dropped": dropped, "unaccounted": sent - len(run.due_s) - sum(dropped.values()),
            "calm_ms": percentiles(run.latency_ms[run.of_phase(0)]), "overload_ms": latency,
            "reconstruct_ms": round(run.reconstruct_ms, 1),
            "bound_ms": round(bound_ms(run), 1), "recovery_s": round(run.recovery_s, 2)}


def bound_ms(run: Run) -> float:
    """What a frame may take during the overload."""
    return PERIODS * 1e3 / run.capacity_hz + run.reconstruct_ms


def draw(run: Run, path: Path) -> None:
    """Rates, latency and drops over time."""
    figure = Figure(figsize=(10, 8), dpi=100, layout="constrained")
    rates, latency, drops = figure.subplots(3, 1, sharex=True)
    edges = run.edges_s
    for panel in (rates, latency, drops):
        panel.axvspan(edges[1], edges[2], color="#f4efe6", zorder=0)
        panel.grid(color="#d9dce0", linewidth=0.6)
    rates.stairs([phase["rate_hz"] for phase in run.phases], edges, baseline=None, color=SENT, linewidth=2,
                 label="frames sent")
    bins = np.arange(0, edges[-1] + 2, BIN_S)
    came, _ = np.histogram(run.due_s + run.latency_ms * 1e-3, bins)
    rates.stairs(came / BIN_S, bins, baseline=None, color=CAME, linewidth=2, label="clouds that came")
    rates.set(ylabel="per second", title=f"{SIDE} × {SIDE} pixels: {TIMES} times what {os.cpu_count()} cores can take")
    latency.plot(run.due_s, run.latency_ms, ".", color=SENT, markersize=4, label="of each cloud")
    latency.axhline(bound_ms(run), color=BOUND, linestyle="--", linewidth=1,
                    label=f"{PERIODS} frame periods and a reconstruction")
    latency.set(ylabel="latency, ms", ylim=(0, None))
    times = [at_s for at_s, _, _ in run.history]
    causes = sorted(key for key, n in figures(run)["dropped"].items() if n)
    for colour, cause in zip(CAUSES, causes, strict=False):
        drops.step(times, [counted.get(cause, 0) for _, counted, _ in run.history], where="post", color=colour,
                   linewidth=2, label=cause.replace(".dropped.", ": ").replace(".message_lost", ": lost on the way"))
    drops.set(xlabel="time, s", ylabel="frames dropped, by cause", xlim=(0, edges[-1] + 1))
    for panel in (rates, latency, drops):
        panel.legend(frameon=False, fontsize=9, loc="upper right" if panel is not drops else "upper left")
    save_png(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of overload")
    parser.add_argument("--out", type=Path, help="append the line to this file")
    parser.add_argument("--picture", type=Path)
    args = parser.parse_args()
    join_private_network()
    line, run = measure(args.seconds)
    tell(line, args.out)
    if args.picture:
        draw(run, args.picture)


if __name__ == "__main__":
    main()
