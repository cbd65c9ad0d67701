"""The picture of a soak: what each process held, the latency and the CPU, with the limits that were judged."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from srt3d_ros.pictures.png import save_png

# Okabe and Ito (2008): told apart with any colour vision.
COLOURS = {"recorder": "#d55e00", "reconstructor": "#0072b2", "sketcher": "#009e73", "player": "#6b7280"}
DASHES = {"recorder": "-", "reconstructor": "-", "sketcher": (0, (4, 3)), "player": (0, (1, 3))}    # lines may coincide
SHARED = "#7b3294"
LIMIT, GRID, WINDOW, HEADROOM = "#c1121f", "#d9dce0", "#f1ede2", 1.25


def draw(result: dict, path: Path) -> None:
    """Six panels over the minutes of the run; the first and the last judged minute are shaded, limits are dashed red.

    Args:
        result: what soak.py writes.
        path: a .png file.
    """
    samples, figures = result["samples"], result["figures"]
    minutes = np.array(samples["time_s"]) / 60
    figure = Figure((13.5, 9.5), dpi=100, layout="constrained")
    figure.suptitle(f"{figures['minutes']:g} minutes of the pipeline at {figures['rate_hz']:g} Hz: "
                    f"{'all limits held' if result['holds'] else 'a limit was passed'}", size=14)
    panels = figure.subplots(3, 2, sharex=True)
    (memory, threads), (files, shared), (latency, cpu) = panels
    for panel in panels.flat:
        panel.grid(color=GRID, linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
        for begin_s, end_s in figures["windows_s"]:
            panel.axvspan(begin_s / 60, end_s / 60, color=WINDOW, zorder=0)
        panel.set_xlim(0, minutes[-1])
    for panel in panels[-1]:
        panel.set_xlabel("minutes")
    draw_memory(memory, minutes, samples, figures)
    for panel, kind, title in ((threads, "threads", "threads"), (files, "fds", "open file descriptors")):
        for name, colour in COLOURS.items():
            panel.plot(minutes, samples[name][kind], color=colour, linestyle=DASHES[name], linewidth=1.8, label=name)
        panel.set_title(f"{title}: no more than at the start", loc="left", size=11)
        panel.set_ylim(0, HEADROOM * max(max(samples[name][kind]) for name in COLOURS))
        panel.legend(frameon=False, ncols=4, fontsize=9, loc="upper right")
    draw_shared(shared, minutes, samples)
    draw_latency(latency, result)
    for name, colour in COLOURS.items():
        per_minute = np.interp(np.arange(0, minutes[-1] + 1e-9, 0.5), minutes, samples[name]["cpu_s"])
        cpu.stairs(100 * np.diff(per_minute) / 30, np.arange(len(per_minute)) / 2, color=colour, linewidth=1.6,
                   label=name, baseline=None)
    cpu.set_title(f"CPU, % of one of {result['machine']['cpus']} cores, of each half minute", loc="left", size=11)
    cpu.set_ylim(0, HEADROOM * cpu.get_ylim()[1])
    cpu.legend(frameon=False, ncols=4, fontsize=9, loc="upper right")
    path.parent.mkdir(parents=True, exist_ok=True)
    save_png(figure, path)


def draw_memory(panel: Axes, minutes: np.ndarray, samples: dict, figures: dict) -> None:
    """Resident memory against the highest in the time of the first judged file."""
    begin_s, end_s = figures["files_s"][0]
    first = (begin_s / 60 <= minutes) & (minutes <= end_s / 60)
    for name, colour in COLOURS.items():
        rss = np.array(samples[name]["rss_mb"])
        base = rss[first].max()
        panel.plot(minutes, 100 * (rss / base - 1), color=colour, linewidth=1.6, label=f"{name}, {base:.0f} MB")
    panel.axhline(figures["growth_percent"], color=LIMIT, linestyle="--", linewidth=1.2)
    panel.set_title(f"resident memory, % above its highest from minute {begin_s / 60:.2g} to {end_s / 60:.2g}",
                    loc="left", size=11)
    low, high = panel.get_ylim()
    panel.set_ylim(max(low, -25), max(1.3 * high, 3 * figures["growth_percent"]))
    panel.legend(frameon=False, ncols=2, fontsize=9, loc="upper left")


def draw_shared(panel: Axes, minutes: np.ndarray, samples: dict) -> None:
    """Shared memory: its size, and how many files it is."""
    panel.plot(minutes, samples["shm_mb"], color=SHARED, linewidth=1.6, label="MB")
    panel.plot(minutes, samples["shm_entries"], color=SHARED, linewidth=1.6, linestyle=":", label="files")
    panel.set_title("/dev/shm, of these processes: no more than at the start", loc="left", size=11)
    panel.set_ylim(0, HEADROOM * max(samples["shm_mb"]))
    panel.legend(frameon=False, ncols=2, fontsize=9, loc="upper right")


def draw_latency(panel: Axes, result: dict) -> None:
    """Percentiles of each minute, and what the last of them may be."""
    at, ms = np.array(result["latency"]["arrived_s"]) / 60, np.array(result["latency"]["ms"])
    edges = np.arange(0, max(np.floor(at[-1]), 1) + 1)
    for percentile, style in ((50, ":"), (95, "-")):
        minutes = [ms[(begin <= at) & (at < end)] for begin, end in zip(edges, edges[1:])]
        each = [np.percentile(minute, percentile) if len(minute) else np.nan for minute in minutes]
        panel.stairs(each, edges, color="black", linestyle=style, linewidth=1.6, baseline=None,
                     label=f"{percentile} % of the clouds")
    limit = result["figures"]["latency_limit_ms"]
    panel.axhline(limit, color=LIMIT, linestyle="--", linewidth=1.2)
    panel.set_title("latency from the stamp to the cloud, ms, of each minute", loc="left", size=11)
    panel.set_ylim(0, HEADROOM * np.nanmax([limit, *each]))
    panel.legend(frameon=False, ncols=2, fontsize=9, loc="lower right")
