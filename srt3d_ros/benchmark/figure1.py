"""Figure 1 of the SRT3D paper: the time of a frame against its photons, of methods on sketches and on all photons.

Times are those of the reconstruction alone: from photons or from a sketch in memory to a cloud in memory. Sketching,
which goes on while the photons come, is timed beside it.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from srt3d_ros.benchmark import frames, placement, timing
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.progress import Progress
from srt3d_ros.benchmark.sketching import anew
from srt3d_ros.benchmark.table1 import PAPER_GPU, PAPER_MS, digits, megabytes
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.evaluation.table import aligned

TITLE = "Figure 1 of the paper: a frame's time against its photons, m = 10"
SKETCH_SIZE = 10
METHOD_NAMES = ("rt3d", "xcorr", "smle", "srt3d", "pooled")
RATIOS_AT_PPP = 1000
SWEEP = 4               # times as many repeats where photon counts are compared
HEADINGS = ("ppp", "method", "device", "ms: min", "median", "max", "times pooled", "its input, MB", "memory, MB")


def steps(plan: Plan) -> int:
    """By how much the bar moves."""
    methods = timing.runs(len(METHOD_NAMES), plan.repeats) + timing.runs(1, plan.repeats)
    return len(plan.ppps) * (methods + timing.runs(1, SWEEP * plan.repeats))


def measure(plan: Plan, bar: Progress, note) -> Iterator[dict]:
    """A line for each method and number of photons, then pooled at all numbers of photons in turns."""
    sensor = frames.sensor_of(plan.side)
    reconstructors, sketches, too_slow = _built(sensor, plan, bar, note), {}, set()
    for ppp, next_ppp in zip(plan.ppps, (*plan.ppps[1:], 0)):
        bar.says(f"{ppp:g} photons per pixel: photons")
        photons = frames.photons_of(sensor, ppp)
        works, facts = {}, {}
        for name, reconstructor in reconstructors.items():
            if name in too_slow:
                bar.update(timing.runs(1, plan.repeats))
                continue
            frame = _input(name, photons, sensor, plan.device)
            if name == "pooled":
                sketches[ppp] = frame
            settles = METHODS[name].needs == "sketch"       # those on photons compile in warm_up, and may take a minute
            works[name] = timing.Work(lambda run=reconstructor, frame=frame: run(frame), reconstructor.device,
                                      f"{ppp:g} photons per pixel: {name}", settles)
            facts[name] = {"what": "reconstruct", **_facts(name, sensor, ppp, photons, reconstructor.device),
                           "input_bytes": input_bytes(name, frame, sensor)}
        works["sketching"], facts["sketching"] = _sketching(sensor, photons, ppp, plan.device)
        for name, result in timing.in_turns(works, plan.repeats, bar, plan.patience_s).items():
            line = facts[name] | result.figures()
            if min(result.seconds) * next_ppp / ppp > plan.limit_s:     # no method's time grows faster than the photons
                too_slow.add(name)
                line["over_limit_s"] = plan.limit_s
                note(too_slow_text(line))
            yield line
        del photons, works
    yield from _sweep(sensor, reconstructors, sketches, plan, bar)


def _sweep(sensor: SensorModel, reconstructors: dict, sketches: dict, plan: Plan, bar: Progress) -> Iterator[dict]:
    """pooled on all numbers of photons in turns: whether it is flat shows only if the machine is the same for all."""
    if "pooled" not in reconstructors:
        return
    run = reconstructors["pooled"]
    works = {ppp: timing.Work(lambda frame=frame: run(frame), run.device, f"pooled in turns, {ppp:g} photons per pixel")
             for ppp, frame in sketches.items()}
    results = timing.in_turns(works, SWEEP * plan.repeats, bar)
    medians = [result.median_ms for result in results.values()]
    fastest = [1e3 * min(result.seconds) for result in results.values()]
    yield {"what": "flatness", "method": "pooled", "rows": sensor.rows, "cols": sensor.cols, "sketch_size": SKETCH_SIZE,
           "device": run.device, "ppps": list(results), "repeats": SWEEP * plan.repeats,
           "median_ms": [float(f"{ms:.5g}") for ms in medians], "min_ms": [float(f"{ms:.5g}") for ms in fastest],
           "max_over_min": round(max(medians) / min(medians), 3),
           "max_over_min_of_fastest": round(max(fastest) / min(fastest), 3)}


def _built(sensor: SensorModel, plan: Plan, bar: Progress, note) -> dict:
    """Every method that can be had here, warm."""
    built = {}
    for name in METHOD_NAMES:
        bar.says(f"{name} compiles")
        try:
            built[name] = placement.built(METHODS[name], sensor, _frequencies(name, sensor), plan.device)
        except ModuleNotFoundError as error:
            note(f"{name} is left out: {error.name} is not installed")
            bar.update(len(plan.ppps) * timing.runs(1, plan.repeats))
    return built


def _frequencies(name: str, sensor: SensorModel) -> tuple[int, ...]:
    return choose(METHODS[name].frequencies, sensor, SKETCH_SIZE)


def _input(name: str, photons: PhotonEvents, sensor: SensorModel, device: str) -> PhotonEvents | Sketch:
    """What the method is given."""
    if METHODS[name].needs == "photons":
        return photons
    return placement.sketched(photons, sensor, _frequencies(name, sensor), device).on_host()


def input_bytes(name: str, frame: PhotonEvents | Sketch, sensor: SensorModel) -> int:
    """What must be held of a frame for the method: its photons, for xcorr uint16 histograms, or its sketch."""
    if isinstance(frame, Sketch):
        return frame.sums.nbytes + frame.photons.nbytes
    return 2 * sensor.pixels * sensor.num_bins if name == "xcorr" else frame.pixel.nbytes + frame.toa.nbytes


def _sketching(sensor: SensorModel, photons: PhotonEvents, ppp: float, device: str) -> tuple[timing.Work, dict]:
    """The sketching of the same photons."""
    sketcher = Sketcher(sensor, _frequencies("pooled", sensor), device=device)
    call = placement.sketchings(sketcher, photons, anew)[placement.HOST]
    return (timing.Work(call, device, f"{ppp:g} photons per pixel: sketching"),
            {"what": "sketch", **_facts("sketching", sensor, ppp, photons, device)})


def _facts(name: str, sensor: SensorModel, ppp: float, photons: PhotonEvents, device: str) -> dict:
    return {"method": name, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
            "sketch_size": SKETCH_SIZE if name not in METHODS or METHODS[name].needs == "sketch" else None,
            "ppp": ppp, "sbr": frames.SBR, "photons": photons.photons, "device": device, "frame_from": placement.HOST}


def table(lines: Sequence[dict]) -> str:
    """For people: the times, then what follows from them."""
    timed = [line for line in lines if line["what"] != "flatness"]
    ours = {line["ppp"]: line["ms"]["median"] for line in timed if line["method"] == "pooled"}
    text = [aligned([HEADINGS, *(_cells(line, ours.get(line["ppp"])) for line in timed)])] if timed else []
    text += [f"{too_slow_text(line)}." for line in timed if "over_limit_s" in line]
    at = {line["method"]: line["ms"]["median"] for line in timed if line["ppp"] == RATIOS_AT_PPP}
    text += [f"At {RATIOS_AT_PPP} photons per pixel {name} takes {at[name] / at['pooled']:.1f} times as long as pooled."
             for name in ("rt3d", "xcorr") if name in at and "pooled" in at]
    text += [f"pooled from {min(line['ppps']):g} to {max(line['ppps']):g} photons per pixel, in turns: slowest median "
             f"/ fastest = {line['max_over_min']:.2f} (of the fastest runs {line['max_over_min_of_fastest']:.2f})."
             for line in lines if line["what"] == "flatness"]
    return "\n".join(text)


def too_slow_text(line: dict) -> str:
    """Why a method has no lines for more photons than this one."""
    return f"{line['method']} is not run on more than {line['ppp']:g} photons per pixel: it would take longer than " \
           f"{line['over_limit_s']:g} s"


def _cells(line: dict, ours_ms: float | None) -> list[str]:
    ms = line["ms"]
    times = f"{ms['median'] / ours_ms:.1f}" if ours_ms else "–"
    return [f"{line['ppp']:g}", line["method"], line["device"],
            *(digits(ms[name]) for name in ("min", "median", "max")), times, megabytes(line.get("input_bytes")),
            megabytes(line.get("growth_bytes"))]


def draw(path: Path, lines: Sequence[dict]) -> None:
    """The figure: time and memory against photons per pixel."""
    from srt3d_ros.pictures.curves import draw_growth
    timed = [line for line in lines if line["what"] != "flatness"]
    first = timed[0]
    side = first["rows"]
    paper_ms = PAPER_MS.get((side, SKETCH_SIZE))
    chip = next((line["gpu"] for line in timed if "gpu" in line), f"{first['cpus']} × {first['machine']}")
    stopped = {line["method"]: f"next over {line['over_limit_s']:g} s" for line in timed if "over_limit_s" in line}
    draw_growth(path, timed, f"{side} × {first['cols']} pixels, {first['num_bins']} bins, SBR {first['sbr']:g}, "
                f"m = {SKETCH_SIZE}; {chip}, {first['date']}",
                None if paper_ms is None else (paper_ms, f"SRT3D in the paper, {PAPER_GPU}: {paper_ms} ms"), stopped)
