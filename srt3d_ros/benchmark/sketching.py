"""Sketching: photons a second into a frame's sketch, in each form in which they come."""

from collections.abc import Iterator, Sequence

from srt3d_ros.benchmark import frames, timing, works
from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.results import digits
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.evaluation.results import aligned

TITLE = "Sketching, m = 10"
SKETCH_SIZE = 10
FORMS = ("sorted", "unsorted", "gates")
ARRAY_HZ = 150_400          # readouts a second of the 32 × 32 array of the RT3D paper
HEADINGS = ("photons", "ppp", "device", "ms: min", "median", "max", "photons/s", "readouts/s",
            f"× {ARRAY_HZ:,}/s")


def measure(plan: Plan, bar: timing.Progress) -> Iterator[dict]:
    """A line for each form and number of photons."""
    sensor, array = frames.sensor_of(plan.side), frames.gates_sensor()
    timed: list[timing.Work] = []
    for ppp in plan.dense_ppps:
        bar.show(f"{ppp:g} photons per pixel")
        photons = frames.photons_of(sensor, ppp)
        timed.append(_work("sorted", sensor, photons, ppp, plan.device))
        timed.append(_work("unsorted", sensor, frames.shuffled(photons), ppp, plan.device))
        timed.append(_work("gates", array, frames.gates_of(array, ppp, plan.cycles), ppp, plan.device))
    timing.in_turns(timed, plan.repeats, bar, plan.repeat_limit_s)
    for work in timed:
        line = work.line()
        for count, rate in (("photons", "photons_per_s"), ("cycles", "readouts_per_s")):
            if count in line:
                line[rate] = float(f"{1e3 * line[count] / work.median_ms:.4g}")
        yield line


def _work(form: str, sensor: SensorModel, frame: PhotonFrame, ppp: float, device: str) -> timing.Work:
    """What to time for one frame."""
    sketcher = Sketcher(sensor, choose("auto", sensor, SKETCH_SIZE), device=device)
    sketcher.add(frame)         # compiles
    facts = {"what": "sketch", "form": form, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
             "sketch_size": SKETCH_SIZE, "ppp": ppp, "photons": int(sketcher.sketch().on_host().photons.sum()),
             "device": device}
    if isinstance(frame, PhotonGates):
        facts["cycles"] = len(frame.words)
    return works.sketching(sketcher, frame, f"{form}, {ppp:g} photons per pixel", facts)


def table(lines: Sequence[dict]) -> str:
    """For people."""
    return aligned([HEADINGS, *(_cells(line) for line in sorted(lines, key=lambda line: FORMS.index(line["form"])))])


def _cells(line: dict) -> list[str]:
    rate = line.get("readouts_per_s")
    return [line["form"], f"{line['ppp']:g}", line["device"], *map(digits, line["ms"].values()),
            f"{line['photons_per_s']:.3g}", f"{rate:.3g}" if rate else "–", f"{rate / ARRAY_HZ:.1f}" if rate else "–"]
