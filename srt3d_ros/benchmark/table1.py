"""Table 1 of the SRT3D paper: the time of a frame against the size of image and sketch, and the memory it takes."""

from collections.abc import Iterator, Sequence

from srt3d_ros.benchmark import frames, timing, works
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.results import digits, megabytes
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.evaluation.results import aligned

TITLE = "Table 1 of the paper: reconstruction of a frame"
METHOD_NAMES = ("pooled", "srt3d")
PPP = 10.0                  # the time does not depend on it: Figure 1
PAPER_GPU = "RTX 3070 laptop"
PAPER_MS = {(141, 5): 6, (282, 5): 12, (423, 5): 28, (564, 5): 55, (705, 5): 68,
            (141, 10): 7, (282, 10): 18, (423, 10): 35, (564, 10): 60, (705, 10): 88}
HEADINGS = ("pixels", "m", "method", "device", "ms: min", "median", "max",
            f"{PAPER_GPU} (paper)", "frames/s", "memory, MB", "of the process, MB")


def measure(plan: Plan, bar: timing.Progress) -> Iterator[dict]:
    """A line for each size, sketch size and method."""
    for side in plan.sides:
        bar.show(f"{side}²: photons")
        sensor = frames.sensor_of(side)
        photons = frames.photons_of(sensor, PPP)
        timed: list[timing.Work] = []
        for name in METHOD_NAMES:
            for m in plan.sketch_sizes:
                bar.show(f"{side}²: {name} compiles")
                frequencies = choose(METHODS[name].frequencies, sensor, m)
                sketch = works.sketched(photons, sensor, frequencies, plan.device)
                reconstructor = works.built(METHODS[name], sensor, frequencies, plan.device)
                facts = {"what": "reconstruct", "method": name, "rows": side, "cols": side, "num_bins": sensor.num_bins,
                         "sketch_size": m, "ppp": PPP, "sbr": frames.SBR, "paper_ms": PAPER_MS.get((side, m))}
                timed.append(works.reconstruction(reconstructor, sketch, f"{side}², m = {m}: {name}", facts))
        del photons
        timing.in_turns(timed, plan.repeats, bar, plan.repeat_limit_s)
        for work in timed:
            yield work.line() | {"frames_per_s": round(1e3 / work.median_ms, 1)}


def table(lines: Sequence[dict]) -> str:
    """For people."""
    rows = sorted(lines, key=lambda line: (line["rows"], line["sketch_size"]))
    return aligned([HEADINGS, *(_cells(line) for line in rows)])


def _cells(line: dict) -> list[str]:
    return [f"{line['rows']}²", str(line["sketch_size"]), line["method"], line["device"],
            *map(digits, line["ms"].values()), str(line["paper_ms"] or "–"), digits(line["frames_per_s"]),
            megabytes(line.get("growth_bytes")), megabytes(line.get("process_peak_bytes"))]
