"""Run methods on cases and compare their clouds with the truth."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from statistics import NormalDist

import numpy as np
from tqdm import tqdm

from srt3d_ros import __version__
from srt3d_ros.core.cloud import PointCloud, refine
from srt3d_ros.core.methods import Method
from srt3d_ros.core.metrics import evaluate, median_offset, shares_within
from srt3d_ros.core.sketch_design import design_for
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation import held_out
from srt3d_ros.evaluation.cases import Case, Observation, photons_near
from srt3d_ros.evaluation.results import Results, format_value
from srt3d_ros.recording import cloud_files

# Shares of a normal distribution at which the reported standard deviations of depth are checked.
NOMINAL = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.6827, 0.8, 0.9, 0.9545, 0.99)
# How many standard deviations hold them: 0.6827 → 1, 0.9545 → 2.
METHOD_OPTIONS = ("false_alarm_rate", "background")      # that may be set for an evaluation
DEVIATIONS = tuple(NormalDist().inv_cdf((1 + share) / 2) for share in NOMINAL)


@dataclass(frozen=True, eq=False)
class Job:
    """One method on one case.

    Args:
        sketch_size: m; None for a method on photons.
        cloud_path: where to save the cloud, or None.
        options: those of METHOD_OPTIONS that were given and that the method takes.
    """

    case: Case
    method: Method
    sketch_size: int | None
    cloud_path: Path | None = None
    options: Mapping[str, object] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Case, method and sketch size, for the progress bar."""
        size = "" if self.sketch_size is None else f", m = {self.sketch_size}"
        return f"{self.case.title}: {self.method.name}{size}"

    @property
    def key(self) -> dict:
        """The columns of the results that identify this job."""
        case = self.case
        aligned = tuple(k + 1 for k in case.aligned) + (case.seen if case.aligned else ())
        return {"source": case.source, "sbr": case.sbr, "ppp": case.ppp, "repeat": case.repeat,
                "method": self.method.name, "sketch_size": self.sketch_size, "surfaces": case.surfaces,
                "rows": case.sensor.rows, "cols": case.sensor.cols, "tolerance_bins": float(case.tolerance_bins),
                "aligned": aligned or None, "held_out": case.held_out,
                **{name: self.options.get(name) for name in METHOD_OPTIONS}}


def jobs_for(cases: Iterable[Case], methods: Iterable[Method], sketch_sizes: Iterable[int],
             options: Mapping[str, object] | None = None) -> list[Job]:
    """Every method on every case, with the options it takes: on sketches once for each size, on photons once."""
    return [Job(case, method, size, options={name: value for name, value in (options or {}).items()
                                             if name in method.options})
            for case in cases for method in methods
            for size in (sketch_sizes if method.needs == "sketch" else (None,))]


def run(jobs: list[Job], results: Results, bar: tqdm) -> list[str]:
    """Run the jobs that the results lack; returns a line for each job that failed with InvalidInput."""
    notes: list[str] = []
    for case, group in groupby(jobs, key=lambda job: job.case):
        every = list(group)
        todo = [job for job in every if not _done(job, results)]
        bar.update(len(every) - len(todo))
        if todo:
            bar.set_description(f"{case.title}: photons")
            observation = case.observe()
            for job in todo:
                bar.set_description(job.title)
                try:
                    results.append(_judged(job, observation))
                except InvalidInput as error:
                    notes.append(f"{job.title}: {error}")
                bar.update()
            del observation         # before the next is made: it may be large
    return notes


def _done(job: Job, results: Results) -> bool:
    return job.key in results and (job.cloud_path is None or job.cloud_path.exists())


def _judged(job: Job, observation: Observation) -> dict:
    """Run a job, save its cloud if `cloud_path` is set, and return the row of results."""
    case, sensor = job.case, job.case.sensor
    cloud, facts = reconstruct(job, observation)
    if job.cloud_path is not None:
        cloud_files.save(cloud, job.cloud_path, frequencies=facts["frequencies"] or (), sensor=case.grid)
    row = job.key | facts | {
        "num_bins": sensor.num_bins, "bin_width_mm": sensor.bin_width_m * 1e3, "points": len(cloud),
        "photons_per_pixel": observation.frame.photons / sensor.pixels, "version": __version__}
    if observation.held_out is not None:
        row |= held_out.gain(cloud, sensor, observation.frame, observation.held_out, case.held_out)
    return row if observation.depth_bins is None else row | judge(cloud, case, observation)


def reconstruct(job: Job, observation: Observation) -> tuple[PointCloud, dict]:
    """A job's cloud, and the frequencies and times (milliseconds) of its reconstruction."""
    sensor, options = job.case.sensor, {"surfaces": job.case.surfaces, **job.options}
    if "upsampling" in job.method.options:
        options["upsampling"] = job.case.upsampling
    seen, frequencies, sketch_ms = observation.frame, None, None
    if job.method.needs == "sketch":
        frequencies = design_for(seen, sensor, frequencies=job.method.frequencies,
                                 sketch_size=job.sketch_size).frequencies
        seen, sketch_ms = _timed(lambda: sketch_photons(observation.frame, sensor, frequencies))
    method = job.method.build(sensor, frequencies, **options)
    method.warm_up()
    cloud, elapsed_ms = _timed(lambda: method(seen))
    return _on_grid(cloud, job.case), {"frequencies": frequencies, "sketch_ms": sketch_ms, "reconstruct_ms": elapsed_ms}


def _on_grid(cloud: PointCloud, case: Case) -> PointCloud:
    """The cloud on the finer pixels; a method without upsampling has each point repeated in all of its pixel."""
    if cloud.background.shape == (case.grid.rows, case.grid.cols):
        return cloud
    flat = np.zeros(len(cloud), np.float32)
    return refine(cloud, case.upsampling, case.grid, flat, flat)


def judge(cloud: PointCloud, case: Case, observation: Observation) -> dict:
    """The columns of the results that compare a cloud with the truth."""
    num_bins = case.sensor.num_bins
    reference, counted, offsets = aligned_reference(cloud, case, observation)
    found = evaluate(cloud, reference, case.tolerance_bins, num_bins, observation.intensity, observation.background,
                     counted, observation.complete)
    shares = shares_within(cloud, reference, num_bins, DEVIATIONS, counted)
    return {"true_detections_percent": 100 * found.true_detections,
            "true_detections_by_surface_percent": tuple(100 * share for share in found.by_surface),
            "false_detections_percent": 100 * found.false_detections, "dae_bins": found.dae_bins,
            "dae_mm": found.dae_bins * case.sensor.bin_width_m * 1e3, "iae": found.iae,
            "background_nmse": found.background_nmse, "within_1_std_percent": 100 * found.within_1_std,
            "within_2_std_percent": 100 * found.within_2_std, "swelling_px": found.swelling_px,
            "offset_bins": offsets or None,
            "within_nominal_percent": tuple(100 * share for share in shares)}


def aligned_reference(cloud: PointCloud, case: Case, observation: Observation):
    """The references with `case.aligned` shifted by their median offset from the cloud; which count; the offsets.

    An aligned reference counts only where photons confirm it: `case.seen`.
    """
    reference = np.array(observation.depth_bins, dtype=np.float64)
    counted, offsets = np.isfinite(reference), []
    for surface in case.aligned:
        offset = 0.0
        for _ in range(2):              # the second time with the photons near its new position
            moved = (reference[surface] + offset) % case.sensor.num_bins
            near = photons_near(observation.frame, moved, case.seen[1], case.sensor) >= case.seen[0]
            offset += median_offset(cloud, np.where(near, moved, np.nan), case.seen[1], case.sensor.num_bins)
        reference[surface] = (reference[surface] + offset) % case.sensor.num_bins
        counted[surface] &= near
        offsets.append(offset)
    return reference, counted, tuple(offsets)


def with_clouds(jobs: list[Job], wanted: Callable[[Job], bool], folder: Path) -> list[Job]:
    """The jobs; those wanted save their cloud in the folder."""
    return [replace(job, cloud_path=folder / f"{_file_name(job)}.npz") if wanted(job) else job for job in jobs]


def _file_name(job: Job) -> str:
    parts = ("source", "sbr", "ppp", "repeat", "method", "sketch_size", "surfaces", "held_out", *METHOD_OPTIONS)
    key = {name: format_value(job.key[name]) for name in parts}
    return "_".join(f"{name}-{text}" if name != "source" else text for name, text in key.items() if text)


def _timed(compute):
    """The result of compute(), and its duration in milliseconds."""
    started = time.perf_counter()
    result = compute()
    return result, (time.perf_counter() - started) * 1e3
