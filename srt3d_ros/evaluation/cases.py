"""Cases to evaluate: photons of the simulator or of files with their truth, made when needed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from srt3d_ros import datasets
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.simulation.bust import Bust
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.evaluation import held_out
from srt3d_ros.evaluation.scenes import NetScene, net_sensor

# Scene, sensor, and default tolerance and surfaces a pixel.
SCENES = {"bust": (Bust, default_sensor, "40mm", 1), "net": (NetScene, net_sensor, "3", 2)}
FILE_TOLERANCE = "10"
SEED = 1


@dataclass(frozen=True, eq=False)
class Observation:
    """Photons and their truth, if known."""

    frame: PhotonEvents
    depth_bins: np.ndarray | None               # float [S, rows, cols], NaN = unknown or no surface
    intensity: np.ndarray | None = None         # float [S, rows, cols], expected signal photons
    complete: bool = False                      # pixels without a depth have no surface, instead of an unknown one
    held_out: PhotonEvents | None = None        # kept from `frame` to judge the clouds

    def true_cloud(self, sensor: SensorModel) -> PointCloud | None:
        """The cloud of a perfect reconstruction; None without a reference."""
        if self.depth_bins is None:
            return None
        depth = np.swapaxes(self.depth_bins, 0, 1)
        intensity = 1.0 if self.intensity is None else np.swapaxes(self.intensity, 0, 1)
        return PointCloud.from_layers(sensor, depth, np.where(np.isfinite(depth), intensity, 0),
                                 np.zeros(sensor.shape), 0)


@dataclass(frozen=True, eq=False)
class Case:
    """One observation on which all methods are evaluated."""

    source: str                                 # name of the scene or file
    sensor: SensorModel
    observe: Callable[[], Observation]          # makes the photons
    surfaces: int                               # K, most surfaces in a pixel
    tolerance_bins: float                       # τ, the largest depth error of a true detection
    sbr: float | None = None                    # signal over background of a simulation
    ppp: float | None = None                    # mean photons per pixel of a simulation
    notes: tuple[str, ...] = ()                 # for the user
    held_out: float | None = None               # share of the photons that judges the cloud of the others

    @property
    def title(self) -> str:
        """Source, SBR and photons per pixel."""
        return self.source if self.sbr is None else f"{self.source}, SBR {self.sbr:g}, {self.ppp:g} ppp"


def simulated(scene: str, sbrs: Sequence[float], ppps: Sequence[float], tolerance: str | None = None,
              surfaces: int | None = None) -> list[Case]:
    """A scene of SCENES at every signal-to-background ratio and number of photons per pixel.

    `tolerance` is as for `tolerance_bins`.
    """
    for sbr in sbrs:
        require(0 < sbr < np.inf, "--sbr", sbr, "ratios above 0")
    for ppp in ppps:
        require(0 < ppp < np.inf, "--ppp", ppp, "photons per pixel, above 0")
    scene_of, make_sensor, usual_tolerance, usual_surfaces = SCENES[scene]
    sensor, count = make_sensor(), surfaces or usual_surfaces
    seen = scene_of(sensor)
    within = tolerance_bins(tolerance or usual_tolerance, sensor)

    def observe(sbr: float, ppp: float) -> Observation:
        simulator = Simulator(seen, sensor, sbr=sbr, ppp=ppp, seed=SEED)
        frame, depth = simulator.frame(0)
        return Observation(frame, depth, simulator.expected(0)[1], complete=True)

    return [Case(scene, sensor, partial(observe, sbr, ppp), count, within, sbr, ppp) for sbr in sbrs for ppp in ppps]


def of_files(files: list[str], tolerance: str | None = None, surfaces: int | None = None,
             held_out_share: float | None = 0, sensor: SensorModel | None = None) -> list[Case]:
    """A case for each photon file; `surfaces` is by default the number of its references.

    Args:
        held_out_share: of the photons; 0 for none, None for USUAL_SHARE of files without a reference.
        sensor: replaces that of the files.
    """
    cases = []
    for photons in (datasets.read_photons(file, sensor=sensor) for file in files):
        references = 0 if photons.reference_depth_bins is None else len(photons.reference_depth_bins)
        within = tolerance_bins(tolerance or FILE_TOLERANCE, photons.sensor)
        share, more = _held_out_share(photons, held_out_share, references)
        # Held-out photons are judged as they were recorded, with pile-up.
        described = photons.sensor if share is None else photons.sensor.replace(cycles=None)
        cases.append(Case(photons.name, described, partial(_observed, photons, share),
                          surfaces or max(references, 1), within, held_out=share,
                          notes=tuple(f"{photons.name}: {note}" for note in (*photons.notes, *more))))
    names = [case.source for case in cases]
    for name in names:
        require(names.count(name) == 1, "files", problem=f"Two files are called {name}: rename one.")
    return cases


def _held_out_share(photons: Reading, asked: float | None, references: int) -> tuple[float | None, tuple[str, ...]]:
    """The share of a file's photons to hold out, or None; and a note if the user did not ask for it."""
    share = held_out.USUAL_SHARE if asked is None and references == 0 else asked
    if not share:
        return None, ()
    least, number = held_out.LEAST_HELD_OUT / min(share, 1 - share), photons.frame.photons
    require(number >= least or asked is None, photons.name, problem=f"{photons.name} has {number} photons: "
            f"--held-out-photons {share:g} needs {np.ceil(least):.0f} or more.")
    if number < least:
        return None, (f"no reference, and too few photons to hold some out ({number}): nothing judges the clouds",)
    note = (f"no reference: clouds of {1 - share:.0%} of the photons are judged by how well they predict the others "
            f"(--held-out-photons {share:g}; 0 for clouds of all photons and no figures)")
    return share, () if asked is not None else (note,)


def tolerance_bins(text: str, sensor: SensorModel) -> float:
    """τ in bins from a text such as "10" (bins) or "40mm" (of range)."""
    expected = "bins such as 10, or millimetres such as 40mm, above 0"
    try:
        value = float(text.removesuffix("mm"))
    except ValueError:
        raise InvalidInput("--tolerance", text, expected) from None
    require(0 < value < np.inf, "--tolerance", text, expected)
    return value * 1e-3 / sensor.bin_width_m if text.endswith("mm") else value


def _observed(photons: Reading, held_out_share: float | None) -> Observation:
    frame, kept = held_out.split(photons.events, held_out_share) if held_out_share else (photons.events, None)
    return Observation(frame, photons.reference_depth_bins, held_out=kept)
