"""Figure 1 of the SRT3D paper: the time of a frame against its photons, of methods on sketches and on all photons.

Times are those of the reconstruction alone: from photons or from a sketch in memory to a cloud in memory. Sketching,
which goes on while the photons come, is timed beside it.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from srt3d_ros.benchmark import frames, timing, works
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.results import digits, megabytes
from srt3d_ros.benchmark.table1 import PAPER_GPU, PAPER_MS
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.evaluation.results import aligned

TITLE = "Figure 1 of the paper: a frame's time against its photons, m = 10"
SKETCH_SIZE = 10
METHOD_NAMES = ("rt3d", "xcorr", "smle", "srt3d", "pooled")
RATIOS_AT_PPP = 1000
SWEEP = 4               # times as many repeats where photon counts are compared
HEADINGS = ("ppp", "method", "device", "ms: min", "median", "max", "times pooled", "its input, MB", "memory, MB")


def measure(plan: Plan, bar: timing.Progress) -> Iterator[dict]:
    """A line for each method and number of photons, then pooled at all numbers of photons in turns."""
    sensor, reconstructors, sketches = frames.sensor_of(plan.side), {}, {}
    for name in METHOD_NAMES:
        bar.show(f"{name} compiles")
        reconstructors[name] = works.built(METHODS[name], sensor, _frequencies(name, sensor), plan.device)
    pooled = reconstructors["pooled"]
    for ppp, next_ppp in zip(plan.ppps, (*plan.ppps[1:], 0)):
        bar.show(f"{ppp:g} photons per pixel: photons")
        photons = frames.photons_of(sensor, ppp)
        facts = {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins, "sketch_size": SKETCH_SIZE,
                 "ppp": ppp, "sbr": frames.SBR, "photons": photons.photons, "device": plan.device}
        timed = []
        for name, reconstructor in reconstructors.items():
            frame = photons
            if METHODS[name].needs == "sketch":
                frame = works.sketched(photons, sensor, _frequencies(name, sensor), plan.device)
            if name == "pooled":
                sketches[ppp] = frame
            timed.append(works.reconstruction(reconstructor, frame, f"{ppp:g} photons per pixel: {name}", {
                "what": "reconstruct", "method": name, **facts,
                "sketch_size": SKETCH_SIZE if METHODS[name].needs == "sketch" else None,
                "input_bytes": input_bytes(name, frame, sensor)}))
        sketcher = Sketcher(sensor, _frequencies("pooled", sensor), device=plan.device)
        timed.append(works.sketching(sketcher, photons, f"{ppp:g} photons per pixel: sketching",
                                     {"what": "sketch", "method": "sketching", **facts}))
        timing.in_turns(timed, plan.repeats, bar, plan.repeat_limit_s)
        for work in timed:
            line = work.line()
            too_slow = min(work.seconds) * next_ppp / ppp > plan.limit_s    # a time grows at most as the photons do
            if too_slow and reconstructors.pop(line["method"], None):
                line["over_limit_s"] = plan.limit_s
                bar.note(too_slow_text(line))
            yield line
        del photons, timed
    yield from _sweep(sensor, pooled, sketches, plan, bar)


def _sweep(sensor: SensorModel, pooled, sketches: dict, plan: Plan, bar: timing.Progress) -> Iterator[dict]:
    """pooled on all numbers of photons in turns: whether it is flat shows only if the machine is the same for all."""
    timed = [works.reconstruction(pooled, frame, f"pooled in turns, {ppp:g} photons per pixel", {})
             for ppp, frame in sketches.items()]
    timing.in_turns(timed, SWEEP * plan.repeats, bar)
    medians, fastest = [work.median_ms for work in timed], [1e3 * min(work.seconds) for work in timed]
    yield {"what": "flatness", "method": "pooled", "rows": sensor.rows, "cols": sensor.cols, "sketch_size": SKETCH_SIZE,
           "device": pooled.device, "ppps": list(sketches), "repeats": SWEEP * plan.repeats,
           "median_ms": [float(f"{ms:.5g}") for ms in medians], "min_ms": [float(f"{ms:.5g}") for ms in fastest],
           "max_over_min": round(max(medians) / min(medians), 3),
           "max_over_min_of_fastest": round(max(fastest) / min(fastest), 3)}


def _frequencies(name: str, sensor: SensorModel) -> tuple[int, ...]:
    return choose(METHODS[name].frequencies, sensor, SKETCH_SIZE)


def input_bytes(name: str, frame: PhotonEvents | Sketch, sensor: SensorModel) -> int:
    """What must be held of a frame for the method: its photons, for xcorr uint16 histograms, or its sketch."""
    if isinstance(frame, Sketch):
        return frame.sums.nbytes + frame.photons.nbytes
    return 2 * sensor.pixels * sensor.num_bins if name == "xcorr" else frame.pixel.nbytes + frame.toa.nbytes


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
    return [f"{line['ppp']:g}", line["method"], line["device"], *map(digits, ms.values()),
            f"{ms['median'] / ours_ms:.1f}" if ours_ms else "–", megabytes(line.get("input_bytes")),
            megabytes(line.get("growth_bytes"))]


def draw(path: Path, lines: Sequence[dict]) -> None:
    """The figure: time and memory against photons per pixel."""
    from srt3d_ros.pictures.curves import draw_growth
    timed = [line for line in lines if line["what"] != "flatness"]
    first = timed[0]
    paper_ms = PAPER_MS.get((first["rows"], SKETCH_SIZE))
    chip = next((line["gpu"] for line in timed if "gpu" in line), f"{first['cpus']} × {first['machine']}")
    stopped = {line["method"]: f"next over {line['over_limit_s']:g} s" for line in timed if "over_limit_s" in line}
    draw_growth(path, timed, f"{first['rows']} × {first['cols']} pixels, {first['num_bins']} bins, SBR "
                f"{first['sbr']:g}, m = {SKETCH_SIZE}; {chip}, {first['date']}",
                None if paper_ms is None else (paper_ms, f"SRT3D in the paper, {PAPER_GPU}: {paper_ms} ms"), stopped)
