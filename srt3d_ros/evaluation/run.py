"""Run methods on cases, and compare their clouds with the truth."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from tqdm import tqdm

from srt3d_ros import __version__
from srt3d_ros.core.methods import Method
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation import held_out
from srt3d_ros.evaluation.cases import Case, Observation
from srt3d_ros.photons import Photons


class Run(NamedTuple):
    """A method, and its sketch size m; None for a method on photons."""

    method: Method
    sketch_size: int | None

    @property
    def label(self) -> str:
        """Method and sketch size."""
        return self.method.name if self.sketch_size is None else f"{self.method.name}, m = {self.sketch_size}"


class Outcome(NamedTuple):
    """The cloud of a run on a case, and its row of results.csv."""

    case: Case
    run: Run
    cloud: PointCloud
    row: dict


def runs_of(methods: Iterable[Method], sketch_sizes: Iterable[int]) -> list[Run]:
    """Every method; those on sketches once for each size."""
    return [Run(method, size) for method in methods
            for size in (sketch_sizes if method.needs == "sketch" else (None,))]


def run_all(cases: Iterable[Case], runs: Sequence[Run], notes: list[str], bar: tqdm) -> Iterator[Outcome]:
    """Yield the outcome of each run on each case; one that fails with InvalidInput adds a line to `notes` instead."""
    for case in cases:
        bar.set_description(f"{case.title}: photons")
        observation = case.observe()
        for run in runs:
            title = f"{case.title}: {run.label}"
            bar.set_description(title)
            try:
                yield outcome(case, run, observation)
            except InvalidInput as error:
                notes.append(f"{title}: {error}")
            bar.update()
        del observation         # frees its memory before the next one


def outcome(case: Case, run: Run, observation: Observation) -> Outcome:
    """Run a method on a case, and compare its cloud with the known truth."""
    (method, sketch_size), sensor, frame = run, case.sensor, observation.frame
    cloud = Photons(sensor, frame).reconstruct(method=method.name, sketch_size=sketch_size, surfaces=case.surfaces)
    row = {"source": case.source, "sbr": case.sbr, "ppp": case.ppp, "method": method.name,
           "sketch_size": sketch_size, "surfaces": case.surfaces, "rows": sensor.rows, "cols": sensor.cols,
           "tolerance_bins": float(case.tolerance_bins), "held_out": case.held_out,
           "frequencies": cloud.frequencies or None, "num_bins": sensor.num_bins,
           "bin_width_mm": sensor.bin_width_m * 1e3, "photons_per_pixel": frame.photons / sensor.pixels,
           "points": len(cloud), "sketch_ms": cloud.sketch_ms or None, "reconstruct_ms": cloud.reconstruct_ms or None,
           "version": __version__}
    if observation.held_out is not None:
        row |= held_out.gain(cloud, sensor, frame, observation.held_out, case.held_out)
    if observation.depth_bins is not None:
        row |= judge(cloud, case, observation)
    return Outcome(case, run, cloud, row)


def judge(cloud: PointCloud, case: Case, observation: Observation) -> dict:
    """Columns of results.csv that compare a cloud with the truth."""
    found = evaluate(cloud, observation.depth_bins, case.tolerance_bins, case.sensor.num_bins, observation.intensity,
                     observation.complete)
    return {"true_detections_percent": 100 * found.true_detections,
            "true_detections_by_surface_percent": tuple(100 * share for share in found.by_surface),
            "false_detections_percent": 100 * found.false_detections, "dae_bins": found.dae_bins,
            "dae_mm": found.dae_bins * case.sensor.bin_width_m * 1e3, "iae": found.iae,
            "within_1_std_percent": 100 * found.within_1_std, "within_2_std_percent": 100 * found.within_2_std}
