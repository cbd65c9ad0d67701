"""Sketch, Cloud and Reconstructor: what the library makes of photons, each with the sensor that it belongs to."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.methods import DEFAULT_METHOD, SKETCH_METHODS, find
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching import sketch as core_sketch
from srt3d_ros.core.sketching.photon_frame import PhotonFrame
from srt3d_ros.errors import InvalidInput, quoted, require
from srt3d_ros.progress import compiling

if TYPE_CHECKING:
    from matplotlib.axes import Axes


IMAGES = ("depth_bins", "intensity", "depth_std_bins")


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(PointCloud):
    """The points of one frame, a PointCloud, with their sensor and how they were made.

    Args:
        sensor: places the points: that of the photons, behind a gate if
            there is one.
        facts: what `srt3d reconstruct --json` prints: method, device, photons, frequencies, times in ms, ….
        notes: one line each for what was assumed, estimated or left out.
    """

    sensor: SensorModel = field(kw_only=True)
    facts: dict[str, Any] = field(kw_only=True, default_factory=dict)
    notes: tuple[str, ...] = field(kw_only=True, default=())

    def __repr__(self) -> str:
        range_m = self._range_m()
        where = f" at {range_m.min():.4g} to {range_m.max():.4g} m" if len(self) else ""
        return (f"Cloud of {len(self):,} points{where}, from {self.facts.get('photons', 0):,} photons of "
                f"{self.sensor.rows} × {self.sensor.cols} pixels{_noted(self.notes)}")

    def _range_m(self) -> np.ndarray:
        return self.sensor.range_m(self.depth_bins).astype(np.float32)      # negative ones, too

    def image(self, field: str, surface: int = 0) -> np.ndarray:
        """`depth_bins`, `intensity` or `depth_std_bins` of each pixel; float32 [rows, cols], NaN = no point."""
        require(field in IMAGES, "field", field, " or ".join(IMAGES))
        require(isinstance(surface, int), "surface", quoted(surface), "an integer, 0 for the strongest")
        return super().image(field, surface)

    def save(self, path: str | Path) -> None:
        """Write the cloud by the suffix: .npz (everything), .ply; or draw it: .png, .jpg.

        Raises:
            InvalidInput: another suffix, a path that cannot be written, or an .npz file there that is no cloud.
        """
        from srt3d_ros.datasets import cloud_files

        cloud_files.save(self, path, frequencies=tuple(self.facts.get("frequencies", ())), sensor=self.sensor)

    def plot(self, ax: "Axes | None" = None, *, yaw_deg: float = -20, pitch_deg: float = 10) -> "Axes":
        """Draw the cloud into axes of matplotlib: coloured by range, shaded by intensity, with a scale bar.

        Args:
            ax: to draw into; those of a new figure unless given.
            yaw_deg, pitch_deg: from where it is seen: to the right of the sensor and above it.

        Raises:
            InvalidInput: matplotlib or Pillow is missing.
        """
        image = self.render(yaw_deg=yaw_deg, pitch_deg=pitch_deg)
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.figure().add_axes((0, 0, 1, 1))
        ax.imshow(image)
        ax.set_axis_off()
        return ax

    def render(self, *, yaw_deg: float = -20, pitch_deg: float = 10, size_px: tuple[int, int] = (1200, 900)
               ) -> np.ndarray:
        """The cloud as a picture, uint8 [height, width, 3]; `save` writes one to a file.

        Args:
            yaw_deg, pitch_deg: as of `plot`.
            size_px: width and height of the picture.

        Raises:
            InvalidInput: matplotlib or Pillow is missing.
        """
        try:
            from srt3d_ros.pictures import annotations
        except ImportError as error:
            raise InvalidInput("picture", f"{error}", "pip install 'srt3d_ros[review]' to have been run") from None

        for name, angle in (("yaw_deg", yaw_deg), ("pitch_deg", pitch_deg)):
            require(isinstance(angle, Real), name, quoted(angle), "degrees")
        fits = isinstance(size_px, tuple) and all(isinstance(side, int) and side > 0 for side in size_px)
        require(fits and len(size_px) == 2, "size_px", quoted(size_px), "(width, height), above 0")
        return np.array(annotations.draw_cloud(self, self.sensor, yaw_deg, pitch_deg, size_px).convert("RGB"))


@dataclass(frozen=True, eq=False, repr=False)
class Sketch(core_sketch.Sketch):
    """What is kept of a frame's photons, and the sensor that saw them.

    Sketches of the same frequencies add. `sketch[10:40, 20:50]` is that of a window of pixels, with the sensor of these
    alone.

    Args:
        frequencies: the integers k_l.
        sums: complex64 [rows, cols, m], Σ exp(i ω_l x) over a pixel's photons.
        photons: uint32 [rows, cols], their number.
        sensor: of the photons, behind the gate if there is one.
        notes: one line each for what was assumed, estimated or left out.
    """

    sensor: SensorModel = field(kw_only=True)
    notes: tuple[str, ...] = field(kw_only=True, default=())

    def __post_init__(self) -> None:
        _check_sensor(self.sensor)
        frequencies, sums = _array("frequencies", self.frequencies, 1, "iuf"), _array("sums", self.sums, 3, "c")
        photons = _array("photons", self.photons, 2, "iuf")
        if photons.dtype != np.uint32:
            whole = ((photons >= 0) & (photons < 2**32) & (photons == np.floor(photons))).all()
            require(bool(whole), "photons", "negative or fractional in places", "whole numbers")
        pixels = self.sensor.rows, self.sensor.cols
        require(photons.shape == pixels, "photons shape", photons.shape, f"{pixels}, the sensor's pixels")
        for name, value in (("frequencies", core_sketch.check_frequencies(frequencies, self.sensor.num_bins)),
                            ("sums", sums.astype(np.complex64, copy=False)),
                            ("photons", photons.astype(np.uint32, copy=False))):
            object.__setattr__(self, name, value)
        super().__post_init__()

    def __repr__(self) -> str:
        rows, cols, m = self.sums.shape
        return (f"Sketch of {self.photons.sum():,} photons, {m} numbers in each of {rows} × {cols} pixels"
                f"{_noted(self.notes)}")

    def __add__(self, other: core_sketch.Sketch) -> Self:
        """The sketch of both sets of photons; InvalidInput unless frequencies and sensor are the same."""
        require(self.sensor.same_as(getattr(other, "sensor", None)), "sensor", "another", "the same in both sketches")
        return super().__add__(other)

    def __radd__(self, nothing: int) -> Self:
        """So that sum() adds sketches, which begins with 0."""
        return self if nothing == 0 else NotImplemented

    def __getitem__(self, pixels: slice | tuple[slice, slice]) -> Self:
        """The sketch of a window of pixels; InvalidInput if none is in it."""
        rows, cols = pixels if isinstance(pixels, tuple) and len(pixels) == 2 else (pixels, slice(None))
        return replace(self, sums=self.sums[rows, cols], photons=self.photons[rows, cols],
                       before=None if self.before is None else self.before[rows, cols],
                       sensor=self.sensor.cropped(rows, cols))

    def reconstruct(self, *, method: str = DEFAULT_METHOD, surfaces: int = 1, device: str = "auto",
                    false_alarm_rate: float | None = None, background: str | None = None) -> Cloud:
        """The point cloud; arguments as of `Photons.reconstruct`, of a method on sketches."""
        wanted = f"one that takes sketches: {', '.join(SKETCH_METHODS)}"
        require(find(method).needs == "sketch", "method", method, wanted)
        reconstructor = Reconstructor(self.sensor, self.frequencies, method=method, surfaces=surfaces, device=device,
                                      false_alarm_rate=false_alarm_rate, background=background)
        return reconstructor(self)


class Reconstructor:
    """Reconstructs frames of one sensor, one after the other; `pooled` keeps a memory of them and of the background.

    Args:
        sensor: of the sketches, behind the gate if there is one.
        frequencies: the integers k_l of the sketches; methods on photons need none.
        method, surfaces, device, false_alarm_rate, background: as of `Photons.reconstruct`.
        warm_start: begin with the last frame's surfaces where this one's photons support them (pooled).

    Attributes:
        device: "cpu" or "cuda", where it computes.
        why: the reason, for people to read.

    Raises:
        InvalidInput: naming the argument that cannot be used.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int] = (), *, method: str = DEFAULT_METHOD,
                 surfaces: int = 1, device: str = "auto", false_alarm_rate: float | None = None,
                 background: str | None = None, warm_start: bool = False):
        _check_sensor(sensor)
        frequencies = tuple(_array("frequencies", frequencies, 1, "iuf").tolist())
        require(false_alarm_rate is None or isinstance(false_alarm_rate, Real), "false_alarm_rate",
                quoted(false_alarm_rate), "a probability")
        own = {"surfaces": surfaces, "device": device, "false_alarm_rate": false_alarm_rate, "background": background,
               "warm_start": warm_start or None}
        self._own, self._frequencies = {"method": method, "surfaces": surfaces}, frequencies
        self._build = partial(find(method).build, sensor, self._frequencies,
                              **{name: value for name, value in own.items() if value is not None})
        self._is_warm = False
        try:
            self._method = self._build()
        except RuntimeError as error:
            self._fall_back(error)
        else:
            self.device = getattr(self._method, "device", "cpu")
            self.why = getattr(self._method, "why", f"{method} runs on the CPU")

    @property
    def uneven_background(self) -> float:
        """How uneven the background of the next frame is taken to be (pooled); 0 if flat."""
        return getattr(self._method, "uneven_background", 0.0)

    def warm_up(self) -> None:
        """Compile what is not compiled yet, so that it does not count as time of a frame."""
        if not self._is_warm:
            with compiling():
                self._or_on_the_cpu(lambda: self._method.warm_up())
            self._is_warm = True

    def _or_on_the_cpu(self, task: Callable):
        """What a task returns; if a GPU fails in it, the CPU does it, and all that follows."""
        try:
            return task()
        except RuntimeError as error:           # torch's: no memory, a kernel that failed, or does not compile
            if self.device != "cuda":
                raise
            self._fall_back(error)
            self._method.warm_up()
            return task()

    def _fall_back(self, error: RuntimeError) -> None:
        self.device, self.why = "cpu", f"the GPU failed: {str(error).partition(chr(10))[0]}"
        logging.getLogger(__name__).warning(f"{self.why}: computing on the CPU from now on")
        self._method = self._build(device="cpu")

    def allow(self, false_alarm_rate: float) -> None:
        """Take this false alarm rate from the next frame on (pooled)."""
        self._build.keywords["false_alarm_rate"] = false_alarm_rate
        self._method.allow(false_alarm_rate)

    def __call__(self, seen: core_sketch.Sketch | PhotonFrame) -> Cloud:
        """The cloud of a frame: of its sketch, or of the photons for a method on photons."""
        wanted = core_sketch.Sketch if self._frequencies else PhotonFrame
        require(isinstance(seen, wanted), "seen", type(seen).__name__,
                "a Sketch" if self._frequencies else "a frame of photons (Photons.frame)")
        self.warm_up()
        started = time.perf_counter()
        cloud = self._or_on_the_cpu(lambda: self._method(seen))
        elapsed_ms = round((time.perf_counter() - started) * 1e3, 3)
        sensor, frequencies = self._method.sensor, list(map(int, self._frequencies))
        facts = self._own | {
            "device": self.device, "rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins,
            "photons": int(np.sum(seen.photons)), "sketch_size": len(frequencies) or None, "frequencies": frequencies,
            "points": len(cloud), "sketch_ms": None, "reconstruct_ms": elapsed_ms}
        return Cloud(**vars(cloud), sensor=sensor, facts=facts, notes=getattr(seen, "notes", ()))

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        if hasattr(self._method, "forget"):
            self._method.forget()


def _array(name: str, values: Any, sides: int, kinds: str) -> np.ndarray:
    """Values as an array of so many dimensions, its dtype of one of these kinds; InvalidInput for others."""
    expected = f"an array of {sides} dimensions of {'complex ' if kinds == 'c' else ''}numbers"
    try:
        found = np.asarray(values)
    except ValueError:          # lists of different lengths
        raise InvalidInput(name, type(values).__name__, expected) from None
    require(found.ndim == sides and found.dtype.kind in kinds, name, f"{found.dtype} {found.shape}", expected)
    return found


def _check_sensor(sensor: Any) -> None:
    require(isinstance(sensor, SensorModel), "sensor", type(sensor).__name__, "a Sensor")


def _noted(notes: tuple[str, ...]) -> str:
    return f"; {len(notes)} notes" if notes else ""
