"""Cases: photons with a known truth, from the simulator or from files, made when they are needed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import Photons, open_photons
from srt3d_ros.datasets.scene import NetScene, default_sensor, net_sensor, read_scene
from srt3d_ros.datasets.silhouettes import house, lattice, silhouette_sensor
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.evaluation import held_out

PAPER_SCENES = ("bust", "net")               # evaluated unless others are asked for
SILHOUETTES = {"lattice": lattice, "house": house}
SCENES = (*PAPER_SCENES, *SILHOUETTES)
HEAD_TOLERANCE, NET_TOLERANCE, FILE_TOLERANCE = "40mm", "3", "10"


@dataclass(frozen=True, eq=False)
class Observation:
    """Photons and their truth, as far as it is known.

    Args:
        frame: the photons.
        depth_bins: float [S, rows, cols], NaN = unknown or no surface; None without any reference.
        intensity: float [S, rows, cols], expected signal photons, or None.
        background: float [rows, cols], expected background photons, or None.
        complete: pixels without a depth have no surface; otherwise, their truth is unknown.
        held_out: photons kept from `frame`, which judge the clouds, or None.
    """

    frame: PhotonEvents
    depth_bins: np.ndarray | None
    intensity: np.ndarray | None = None
    background: np.ndarray | None = None
    complete: bool = False
    held_out: PhotonEvents | None = None

    def true_cloud(self, sensor: SensorModel) -> PointCloud | None:
        """The cloud of a perfect reconstruction; None without any reference."""
        if self.depth_bins is None:
            return None
        row, col, surface = np.nonzero(np.moveaxis(np.isfinite(self.depth_bins), 0, -1))
        depth = self.depth_bins[surface, row, col].astype(np.float32)
        intensity = np.ones(len(row)) if self.intensity is None else np.nan_to_num(self.intensity)[surface, row, col]
        background = np.zeros((sensor.rows, sensor.cols)) if self.background is None else self.background
        return PointCloud(row.astype(np.uint16), col.astype(np.uint16), depth, intensity.astype(np.float32),
                          np.zeros(len(row), np.float32), sensor.xyz(row, col, depth), surface.astype(np.uint8),
                          background.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Case:
    """One observation on which all methods are evaluated.

    Args:
        source: name of the scene or file.
        observe: makes the photons.
        surfaces: K, most surfaces in a pixel.
        tolerance_bins: τ: the largest depth error of a true detection.
        size: rough number of photons.
        sbr, ppp: of the simulation: signal over background, mean photons per pixel; None for a file.
        repeat: which of several draws of the same photons, from 1.
        aligned: numbers, from 0, of the references that are shifted by their median offset from the cloud.
        seen: (photons, bins): an aligned reference counts in pixels with so many photons within so many bins of it;
            points farther away do not count for its offset.
        notes: for the user.
        upsampling: u: clouds and truth have u × u finer pixels for each pixel of the sensor.
        held_out: share of the photons that judges the clouds of the others, or None.
    """

    source: str
    sensor: SensorModel
    observe: Callable[[], Observation]
    surfaces: int
    tolerance_bins: float
    size: float
    sbr: float | None = None
    ppp: float | None = None
    repeat: int = 1
    aligned: tuple[int, ...] = ()
    seen: tuple[int, float] = (8, 60.0)
    notes: tuple[str, ...] = ()
    upsampling: int = 1
    held_out: float | None = None

    @cached_property
    def grid(self) -> SensorModel:
        """The sensor with the pixels of clouds and truth."""
        return self.sensor.upsampled(self.upsampling)

    @property
    def title(self) -> str:
        """Source, SBR and photons per pixel, for messages."""
        return self.source if self.sbr is None else f"{self.source}, SBR {self.sbr:g}, {self.ppp:g} ppp"


def simulated(scene: str, sbrs: list[float], ppps: list[float], repeats: int = 1, tolerance: str | None = None,
              surfaces: int | None = None, side: int | None = None, upsampling: int = 1) -> list[Case]:
    """A scene at every signal-to-background ratio and number of photons per pixel.

    Args:
        scene: "bust", "net", "lattice", "house", or a scene file (datasets.scene).
        tolerance: as for `tolerance_bins`.
        side: pixels along the side of the bust, and the most of a file's scene; None: as many as the paper's head has.
        upsampling: u: the scene has u × u finer pixels, whose photons are merged into each pixel of the sensor.
    """
    for sbr in sbrs:
        require(0 < sbr < np.inf, "--sbr", sbr, "ratios above 0")
    for ppp in ppps:
        require(0 < ppp < np.inf, "--ppp", ppp, "photons per pixel, above 0")
    seen, sensor, default = _open_scene(scene, side, upsampling)
    grid = sensor.upsampled(upsampling)
    within = tolerance_bins(default if tolerance is None else tolerance, scene, sensor)
    count = surfaces or (2 if scene == "net" else 1)
    name = (scene if scene in SCENES else Path(scene).stem) + (f"_x{upsampling}" if upsampling > 1 else "")

    def observe(sbr: float, ppp: float, seed: int) -> Observation:
        simulator = Simulator(seen, grid, sbr=sbr, ppp=ppp / upsampling**2, seed=seed)
        _, intensity, background = simulator.expected(0)
        frame, depth = simulator.frame(0)
        return Observation(_merged(frame, grid, upsampling), depth, intensity, background, complete=True)

    return [Case(name, sensor, lambda s=sbr, p=ppp, r=repeat: observe(s, p, r), count, within, ppp * sensor.pixels,
                 sbr, ppp, repeat, upsampling=upsampling)
            for sbr in sbrs for ppp in ppps for repeat in range(1, repeats + 1)]


def of_files(files: list[str], tolerance: str | None = None, surfaces: int | None = None,
             aligned: tuple[int, ...] = (), seen: tuple[int, float] = (8, 60.0),
             held_out_share: float | None = 0) -> list[Case]:
    """Photon files; `surfaces` is by default the number of a file's references.

    Args:
        held_out_share: of the photons, or 0 for none; None: the usual share of a file that has no reference.
    """
    cases = []
    for photons in map(open_photons, files):
        references = 0 if photons.reference_depth_bins is None else len(photons.reference_depth_bins)
        within = tolerance_bins(FILE_TOLERANCE if tolerance is None else tolerance, photons.name, photons.sensor)
        share, more = _held_out_share(photons, held_out_share, references)
        cases.append(Case(photons.name, photons.sensor, lambda p=photons, s=share: _observed(p, s),
                          surfaces or max(references, 1), within, photons.frame.photons,
                          aligned=tuple(k for k in aligned if k < references), seen=seen,
                          notes=tuple(f"{photons.name}: {note}" for note in (*photons.notes, *more)),
                          held_out=share))
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


def tolerance_bins(text: str, source: str, sensor: SensorModel) -> float:
    """τ of a source in bins, from "10", "40mm", or with other values for some: "10,two_layer=40,face=5mm"."""
    parts = [part.strip().rpartition("=") for part in text.split(",")]
    require(sum(not equals for _, equals, _ in parts) == 1, "tolerance", text,
            "one value, and others as NAME=VALUE: 10,two_layer=40")
    bins = {name if equals else None: _bins(value, text, sensor) for name, equals, value in parts}
    return bins.get(source, bins[None])


def _bins(value: str, text: str, sensor: SensorModel) -> float:
    try:
        number = float(value.removesuffix("mm"))
    except ValueError:
        raise InvalidInput("tolerance", text, "bins such as 10, or millimetres such as 40mm") from None
    require(0 < number < np.inf, "tolerance", text, "a distance above 0")
    return number * 1e-3 / sensor.bin_width_m if value.endswith("mm") else number


def photons_near(frame: PhotonEvents, depth_bins: np.ndarray, bins: float, sensor: SensorModel) -> np.ndarray:
    """How many photons of each pixel lie within `bins` of a depth, int [rows, cols]; 0 where the depth is NaN."""
    position = sensor.toa_positions(frame.toa).astype(np.float64)
    apart = np.abs(circular_difference(position, depth_bins.ravel()[frame.pixel], sensor.num_bins))
    return np.bincount(frame.pixel[apart <= bins], minlength=sensor.pixels).reshape(sensor.rows, sensor.cols)


def _merged(frame: PhotonEvents, sensor: SensorModel, factor: int) -> PhotonEvents:
    """The photons in pixels that each cover `factor` × `factor` of the sensor's."""
    if factor == 1:
        return frame
    row, col = np.divmod(frame.pixel, sensor.cols)
    pixel = row // factor * (sensor.cols // factor) + col // factor
    order = np.argsort(pixel, kind="stable")
    return PhotonEvents(pixel[order].astype(np.uint32), frame.toa[order], frame.stamp_ns)


def _observed(photons: Photons, held_out_share: float | None) -> Observation:
    observation = Observation(photons.events, photons.reference_depth_bins, photons.reference_intensity)
    if held_out_share is None:
        return observation
    frame, kept = held_out.split(observation.frame, held_out_share)
    intensity = observation.intensity
    return replace(observation, frame=frame, held_out=kept,
                   intensity=None if intensity is None else (1 - held_out_share) * intensity)


def _open_scene(scene: str, side: int | None, upsampling: int):
    """The scene on finer pixels (None: the simulator's default), its sensor and default tolerance."""
    if scene == "bust":
        sensor = default_sensor()
        if side is not None:
            sensor = sensor.replace(rows=side, cols=side, projection=Pinhole.from_fov(side, side, fov_deg=11.0))
        return None, sensor, HEAD_TOLERANCE
    if scene == "net":
        sensor = net_sensor()
        return NetScene(sensor.upsampled(upsampling)), sensor, NET_TOLERANCE
    if scene in SILHOUETTES:
        sensor = silhouette_sensor()
        return SILHOUETTES[scene](sensor.upsampled(upsampling)), sensor, FILE_TOLERANCE
    require(upsampling == 1, "--upsampling", upsampling, f"1 for {scene}: its pixels are as fine as its depth is known")
    require(scene.lower().endswith(".npz"), "scene", scene, f"{', '.join(SCENES)}, or a scene file .npz")
    return *(read_scene(scene, side) if side is not None else read_scene(scene)), HEAD_TOLERANCE
