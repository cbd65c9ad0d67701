"""Cases: photons with a known truth, from the simulator or from files, made when they are needed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from srt3d_ros import datasets
from srt3d_ros.core.cloud import Cloud
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import Photons
from srt3d_ros.datasets.simulation.bust import Bust
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.evaluation import held_out
from srt3d_ros.evaluation.scenes import NetScene, net_sensor

# Of each scene: what is seen, by which sensor; unless asked otherwise, tolerance and most surfaces in a pixel.
SCENES = {"bust": (Bust, default_sensor, "40mm", 1), "net": (NetScene, net_sensor, "3", 2)}
FILE_TOLERANCE = "10"
SEEN_PHOTONS, SEEN_BINS = 8, 60.0       # an aligned reference counts in pixels with so many photons so near


@dataclass(frozen=True, eq=False)
class Observation:
    """Photons and their truth, as far as it is known.

    Args:
        frame: the photons.
        depth_bins: float [S, rows, cols], NaN = unknown or no surface; None without any reference.
        intensity: float [S, rows, cols], expected signal photons, or None.
        complete: pixels without a depth have no surface; otherwise, their truth is unknown.
        held_out: photons kept from `frame`, which judge the clouds, or None.
    """

    frame: PhotonEvents
    depth_bins: np.ndarray | None
    intensity: np.ndarray | None = None
    complete: bool = False
    held_out: PhotonEvents | None = None

    def true_cloud(self, sensor: SensorModel) -> Cloud | None:
        """The cloud of a perfect reconstruction; None without any reference."""
        if self.depth_bins is None:
            return None
        depth = np.swapaxes(self.depth_bins, 0, 1)
        intensity = 1.0 if self.intensity is None else np.swapaxes(self.intensity, 0, 1)
        return Cloud.from_layers(sensor, depth, np.where(np.isfinite(depth), intensity, 0),
                                 np.zeros((sensor.rows, sensor.cols)), 0)


@dataclass(frozen=True, eq=False)
class Case:
    """One observation on which all methods are evaluated.

    Args:
        source: name of the scene or file.
        observe: makes the photons.
        surfaces: K, most surfaces in a pixel.
        tolerance_bins: τ: the largest depth error of a true detection.
        sbr, ppp: of the simulation: signal over background, mean photons per pixel; None for a file.
        repeat: which of several draws of the same photons, from 1.
        aligned: numbers, from 0, of the references that are shifted by their median offset from the cloud.
        notes: for the user.
        held_out: share of the photons that judges the clouds of the others, or None.
    """

    source: str
    sensor: SensorModel
    observe: Callable[[], Observation]
    surfaces: int
    tolerance_bins: float
    sbr: float | None = None
    ppp: float | None = None
    repeat: int = 1
    aligned: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    held_out: float | None = None

    @property
    def title(self) -> str:
        """Source, SBR and photons per pixel, for messages."""
        return self.source if self.sbr is None else f"{self.source}, SBR {self.sbr:g}, {self.ppp:g} ppp"


def simulated(scene: str, sbrs: Sequence[float], ppps: Sequence[float], repeats: int = 1, tolerance: str | None = None,
              surfaces: int | None = None) -> list[Case]:
    """A scene at every signal-to-background ratio and number of photons per pixel.

    Args:
        scene: one of SCENES.
        tolerance: as for `tolerance_bins`.
    """
    for sbr in sbrs:
        require(0 < sbr < np.inf, "--sbr", sbr, "ratios above 0")
    for ppp in ppps:
        require(0 < ppp < np.inf, "--ppp", ppp, "photons per pixel, above 0")
    scene_of, make_sensor, usual_tolerance, usual_surfaces = SCENES[scene]
    sensor, count = make_sensor(), surfaces or usual_surfaces
    seen = scene_of(sensor)
    within = tolerance_bins(tolerance or usual_tolerance, sensor)

    def observe(sbr: float, ppp: float, seed: int) -> Observation:
        simulator = Simulator(seen, sensor, sbr=sbr, ppp=ppp, seed=seed)
        frame, depth = simulator.frame(0)
        return Observation(frame, depth, simulator.expected(0)[1], complete=True)

    return [Case(scene, sensor, partial(observe, sbr, ppp, repeat), count, within, sbr, ppp, repeat)
            for sbr in sbrs for ppp in ppps for repeat in range(1, repeats + 1)]


def of_files(files: list[str], tolerance: str | None = None, surfaces: int | None = None,
             aligned: Sequence[int] = (), held_out_share: float | None = 0) -> list[Case]:
    """Photon files; `surfaces` is by default the number of a file's references.

    Args:
        held_out_share: of the photons, or 0 for none; None: the usual share of a file that has no reference.
    """
    cases = []
    for photons in map(datasets.read, files):
        references = 0 if photons.reference_depth_bins is None else len(photons.reference_depth_bins)
        within = tolerance_bins(tolerance or FILE_TOLERANCE, photons.sensor)
        share, more = _held_out_share(photons, held_out_share, references)
        # Held-out photons are judged as they were recorded, with pile-up.
        sensor = photons.sensor if share is None else photons.sensor.replace(cycles=None)
        cases.append(Case(photons.name, sensor, partial(_observed, photons, share),
                          surfaces or max(references, 1), within, aligned=tuple(k for k in aligned if k < references),
                          notes=tuple(f"{photons.name}: {note}" for note in (*photons.notes, *more)), held_out=share))
    names = [case.source for case in cases]
    require(len(set(names)) == len(names), "files", max(names, key=names.count, default=""), "each file name once")
    return cases


def _held_out_share(photons: Photons, asked: float | None, references: int) -> tuple[float | None, tuple[str, ...]]:
    """The share of a file's photons that is held out, None without any; and what the user did not ask for."""
    share = held_out.USUAL_SHARE if asked is None and references == 0 else asked
    if not share:
        return None, ()
    least, number = held_out.LEAST_PHOTONS / min(share, 1 - share), photons.frame.photons
    require(number >= least or asked is None, photons.name, f"{number} photons",
            f"{np.ceil(least):.0f} or more for --held-out-photons {share:g}")
    if number < least:
        return None, (f"no reference, and too few photons to hold some out ({number}): nothing judges the clouds",)
    note = (f"no reference: clouds of {1 - share:.0%} of the photons are judged by how well they predict the others "
            f"(--held-out-photons {share:g}; 0 for clouds of all photons and no figures)")
    return share, () if asked is not None else (note,)


def tolerance_bins(text: str, sensor: SensorModel) -> float:
    """τ in bins, from "10" bins or "40mm" of range."""
    expected = "bins such as 10, or millimetres such as 40mm, above 0"
    try:
        value = float(text.removesuffix("mm"))
    except ValueError:
        raise InvalidInput("--tolerance", text, expected) from None
    require(0 < value < np.inf, "--tolerance", text, expected)
    return value * 1e-3 / sensor.bin_width_m if text.endswith("mm") else value


def photons_near(frame: PhotonEvents, depth_bins: np.ndarray, bins: float, sensor: SensorModel) -> np.ndarray:
    """How many photons of each pixel lie within `bins` of a depth, int [rows, cols]; 0 where the depth is NaN."""
    position = frame.toa.astype(np.float64)
    apart = np.abs(circular_difference(position, depth_bins.ravel()[frame.pixel], sensor.num_bins))
    return np.bincount(frame.pixel[apart <= bins], minlength=sensor.pixels).reshape(sensor.rows, sensor.cols)


def _observed(photons: Photons, held_out_share: float | None) -> Observation:
    frame, kept = (photons.events, None) if held_out_share is None else held_out.split(photons.events, held_out_share)
    return Observation(frame, photons.reference_depth_bins, held_out=kept)
