"""Sketching: photons a second into a frame's sketch, in each form in which they come."""

from collections.abc import Iterator, Sequence

from srt3d_ros.benchmark import frames, placement, timing
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.progress import Progress
from srt3d_ros.benchmark.table1 import digits
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.evaluation.table import aligned

TITLE = "Sketching, m = 10"
SKETCH_SIZE = 10
FORMS = ("sorted", "unsorted", "gates")
ARRAY_HZ = 150_400          # readouts a second of the 32 × 32 array of the RT3D paper
HEADINGS = ("photons", "ppp", "device", "frame from", "ms: min", "median", "max", "photons/s", "readouts/s",
            f"× {ARRAY_HZ:,}/s")


def steps(plan: Plan) -> int:
    """By how much the bar moves."""
    return timing.runs(len(FORMS) * len(plan.dense_ppps), plan.repeats)


def measure(plan: Plan, bar: Progress, note) -> Iterator[dict]:
    """A line for each form and number of photons."""
    sensor, array = frames.sensor_of(plan.side), frames.gates_sensor()
    works, facts = {}, {}
    for ppp in plan.dense_ppps:
        bar.says(f"{ppp:g} photons per pixel")
        photons = frames.photons_of(sensor, ppp)
        for form in FORMS:
            seen_by = array if form == "gates" else sensor
            frame = frames.gates_of(array, ppp, plan.cycles) if form == "gates" else photons
            if form == "unsorted":
                frame = frames.shuffled(photons)
            try:
                works |= _works(seen_by, frame, form, ppp, plan.device, facts)
            except ModuleNotFoundError as error:
                note(f"{form} photons are left out: {error.name} is not installed")
    for key, result in timing.in_turns(works, plan.repeats, bar, plan.patience_s).items():
        seconds = result.median_ms / 1e3
        fact = facts[key] | result.figures() | {"photons_per_s": float(f"{facts[key]['photons'] / seconds:.4g}")}
        if "cycles" in fact:
            fact["readouts_per_s"] = float(f"{fact['cycles'] / seconds:.4g}")
        yield fact


def _works(sensor: SensorModel, frame, form: str, ppp: float, device: str, facts: dict) -> dict:
    """What to time for one frame; what is known of each goes to `facts`."""
    frequencies = choose("auto", sensor, SKETCH_SIZE)
    sketcher = Sketcher(sensor, frequencies, device=device)
    sketcher.add(frame)         # compiles
    works, photons = {}, int(sketcher.sketch().on_host().photons.sum())
    for place, call in placement.sketchings(sketcher, frame, anew).items():
        key = form, ppp, place
        works[key] = timing.Work(call, device, f"{form}, {ppp:g} photons per pixel")
        facts[key] = {"what": "sketch", "form": form, "rows": sensor.rows, "cols": sensor.cols,
                      "num_bins": sensor.num_bins, "sketch_size": SKETCH_SIZE, "ppp": ppp, "photons": photons,
                      "device": device, "frame_from": place}
        if isinstance(frame, PhotonGates):
            facts[key]["cycles"] = len(frame.words)
    return works


def anew(frame):
    """The same photons as a frame that has just come: whether they are sorted is not known yet."""
    return PhotonEvents(frame.pixel, frame.toa) if isinstance(frame, PhotonEvents) else PhotonGates(frame.words)


def table(lines: Sequence[dict]) -> str:
    """For people."""
    return aligned([HEADINGS, *(_cells(line) for line in sorted(lines, key=lambda line: FORMS.index(line["form"])))])


def _cells(line: dict) -> list[str]:
    ms, rate = line["ms"], line.get("readouts_per_s")
    return [line["form"], f"{line['ppp']:g}", line["device"], line["frame_from"],
            *(digits(ms[name]) for name in ("min", "median", "max")), f"{line['photons_per_s']:.3g}",
            f"{rate:.3g}" if rate else "–", f"{rate / ARRAY_HZ:.1f}" if rate else "–"]
