"""Table 1 of the SRT3D paper: the time of a frame against the size of image and sketch, and the memory it takes."""

from collections.abc import Iterator, Sequence

from srt3d_ros.benchmark import frames, placement, timing
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.progress import Progress
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.evaluation.table import aligned

TITLE = "Table 1 of the paper: reconstruction of a frame"
METHOD_NAMES = ("pooled", "srt3d")
PPP = 10.0                  # the time does not depend on it: Figure 1
PAPER_GPU = "RTX 3070 laptop"
PAPER_MS = {(141, 5): 6, (282, 5): 12, (423, 5): 28, (564, 5): 55, (705, 5): 68,
            (141, 10): 7, (282, 10): 18, (423, 10): 35, (564, 10): 60, (705, 10): 88}
HEADINGS = ("pixels", "m", "method", "device", "frame from", "ms: min", "median", "max",
            f"{PAPER_GPU} (paper)", "frames/s", "memory, MB", "of the process, MB")


def steps(plan: Plan) -> int:
    """By how much the bar moves."""
    return len(plan.sides) * timing.runs(len(METHOD_NAMES) * len(plan.sketch_sizes), plan.repeats)


def measure(plan: Plan, bar: Progress, note) -> Iterator[dict]:
    """A line for each size, sketch size, method and place of the frame."""
    for side in plan.sides:
        bar.says(f"{side}²: photons")
        sensor = frames.sensor_of(side)
        photons = frames.photons_of(sensor, PPP)
        works, facts = {}, {}
        for name in METHOD_NAMES:
            for m in plan.sketch_sizes:
                frequencies = choose(METHODS[name].frequencies, sensor, m)
                bar.says(f"{side}²: {name} compiles")
                try:
                    sketch = placement.sketched(photons, sensor, frequencies, plan.device)
                    reconstructor = placement.built(METHODS[name], sensor, frequencies, plan.device)
                except ModuleNotFoundError as error:
                    note(f"{name} is left out: {error.name} is not installed")
                    continue
                for place, call in placement.reconstructions(reconstructor, sketch).items():
                    key = name, m, place
                    works[key] = timing.Work(call, reconstructor.device, f"{side}², m = {m}: {name}",
                                             frames=placement.FRAMES.get(place, 1))
                    facts[key] = {"what": "reconstruct", "method": name, "rows": side, "cols": side,
                                  "num_bins": sensor.num_bins, "sketch_size": m, "ppp": PPP, "sbr": frames.SBR,
                                  "device": reconstructor.device, "frame_from": place,
                                  "paper_ms": PAPER_MS.get((side, m))}
        del photons
        for key, result in timing.in_turns(works, plan.repeats, bar, plan.patience_s).items():
            yield facts[key] | result.figures() | {"frames_per_s": round(1e3 / result.median_ms, 1)}


def table(lines: Sequence[dict]) -> str:
    """For people."""
    rows = sorted(lines, key=lambda line: (line["rows"], line["sketch_size"]))
    return aligned([HEADINGS, *(_cells(line) for line in rows)])


def _cells(line: dict) -> list[str]:
    ms, paper_ms = line["ms"], line["paper_ms"]
    return [f"{line['rows']}²", str(line["sketch_size"]), line["method"], line["device"], line["frame_from"],
            *(digits(ms[name]) for name in ("min", "median", "max")), f"{paper_ms}" if paper_ms else "–",
            digits(line["frames_per_s"]),
            *(megabytes(line.get(name)) for name in ("growth_bytes", "process_peak_bytes"))]


def megabytes(count: int | None) -> str:
    """Bytes in 10⁶ bytes, or a dash."""
    return "–" if count is None else digits(count / 1e6)


def digits(value: float) -> str:
    """Three digits, or all of those before the point."""
    return f"{value:.3g}" if value < 999.5 else f"{value:.0f}"
