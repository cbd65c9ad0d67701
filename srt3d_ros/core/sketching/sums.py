"""PhaseSums: what is kept of a frame's photons, and how it adds."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Self

import numpy as np

from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.kernels.constants import MAX_PIXEL_PHOTONS, MAX_SKETCH_SIZE

MAPS = "before", "exposure"         # of pixels, where they are known


def as_array(name: str, values: Any, sides: int, kinds: str) -> np.ndarray:
    """Values as an array of so many dimensions, its dtype of one of these kinds; InvalidInput for others."""
    expected = f"an array of {sides} dimensions of {'complex ' if kinds == 'c' else ''}numbers"
    try:
        array = np.asarray(values)
    except ValueError:          # lists of different lengths
        raise InvalidInput(name, type(values).__name__, expected) from None
    require(array.ndim == sides and array.dtype.kind in kinds, name, f"{array.dtype} {array.shape}", expected)
    return array


def check_frequencies(frequencies: Sequence[int] | np.ndarray, num_bins: int) -> tuple[int, ...]:
    """The frequencies k_l as a tuple of different integers in [1, (T − 1) / 2], or InvalidInput.

    k and T − k carry the same information (one is the other's conjugate); k = 0 carries the photon count only.
    """
    require(0 < len(frequencies) <= MAX_SKETCH_SIZE, "sketch size", len(frequencies),
            f"1 to {MAX_SKETCH_SIZE} frequencies")
    most = max((num_bins - 1) // 2, 1)
    for k in frequencies:
        require(1 <= k <= most and k == int(k), "frequencies", k,
                f"integers from 1 to {most} (T = {num_bins} bins; higher ones repeat these)")
    require(len(set(frequencies)) == len(frequencies), "frequencies", list(frequencies), "no frequency twice")
    return tuple(int(k) for k in frequencies)


@dataclass(frozen=True, eq=False, repr=False)
class PhaseSums:
    """Per pixel, the sum over its photons of exp(i ω_l x_p), ω_l = 2π k_l / T, and their number.

    The paper's sketch is the mean, z_l = sums_l / n (eq. 3). Sketches of the same frequencies add. `sketch[10:40,
    20:50]` is that of a window of pixels, with the sensor of these alone.

    Args:
        frequencies: the integers k_l.
        sums: complex64 [rows, cols, m].
        photons: uint32 [rows, cols], n; pixels with more than MAX_PIXEL_PHOTONS keep so many and the same mean.
        stamp_ns: start of acquisition of the earliest photons; for a window, of its newest frame.
        cycles: N, the laser cycles, if the photons are the first of each; 0: not known, pile-up is not corrected.
        before: uint32 [rows, cols], cycles that photons outside the gate cost: one for each before the gate, or, with
            a dead time of a period or longer, those for which each blinds the gate, on average; None: none.
        exposure: float32 [rows, cols], frames that each pixel has seen, of a `MovingWindow`: `cycles` are those of one
            frame, and clouds have the intensities of one. None: one frame. Sketches with it do not add.
        sensor: of the photons, behind the gate if there is one.

    Raises:
        InvalidInput: naming the argument that cannot be used.
    """

    frequencies: tuple[int, ...]
    sums: np.ndarray
    photons: np.ndarray
    stamp_ns: int = 0
    cycles: int = 0
    before: np.ndarray | None = None
    exposure: np.ndarray | None = None
    _: KW_ONLY
    sensor: SensorModel

    def __post_init__(self) -> None:
        require(isinstance(self.sensor, SensorModel), "sensor", type(self.sensor).__name__, "a Sensor")
        frequencies = check_frequencies(as_array("frequencies", self.frequencies, 1, "iuf"), self.sensor.num_bins)
        sums, photons = as_array("sums", self.sums, 3, "c"), as_array("photons", self.photons, 2, "iuf")
        if photons.dtype != np.uint32:
            whole = ((photons >= 0) & (photons < 2**32) & (photons == np.floor(photons))).all()
            require(bool(whole), "photons", "negative or fractional in places", "whole numbers")
        pixels = self.sensor.shape
        require(photons.shape == pixels, "photons shape", photons.shape, f"{pixels}, the sensor's pixels")
        require(sums.shape == (*pixels, len(frequencies)), "sums shape", sums.shape,
                f"[rows, cols, {len(frequencies)}], rows and cols as of photons")
        for name in MAPS:
            if (value := getattr(self, name)) is not None:
                require(np.shape(value) == pixels, f"{name} shape", np.shape(value), f"{pixels}, the sensor's pixels")
        for name, value in (("frequencies", frequencies), ("sums", sums.astype(np.complex64, copy=False)),
                            ("photons", photons.astype(np.uint32, copy=False))):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        rows, cols, m = self.sums.shape
        return f"{type(self).__name__} of {self.photons.sum():,} photons, {m} numbers in each of {rows} × {cols} pixels"

    @property
    def z(self) -> np.ndarray:
        """The paper's sketch, sums / n; complex64 [rows, cols, m], 0 where a pixel saw no photon."""
        each = 1 / np.maximum(self.photons, 1)[..., None].astype(np.float32)
        # real numbers, because complex ones take four times as long to divide
        return (np.ascontiguousarray(self.sums).view(np.float32) * each).view(np.complex64)

    @property
    def frames(self) -> np.ndarray:
        """`exposure`, or 1 everywhere; float32 [rows, cols]."""
        return np.ones(self.photons.shape, np.float32) if self.exposure is None else self.exposure

    @property
    def armed_cycles(self) -> np.ndarray:
        """Cycles in which a pixel could still see a photon in the sketch's bins; float64 [rows, cols]."""
        before = 0 if self.before is None else self.before
        return np.maximum(np.float64(self.cycles) * self.frames - before, self.photons)

    def __add__(self, other: Self) -> Self:
        """The sketch of both sets of photons; InvalidInput unless frequencies and sensor are the same."""
        require(self.frequencies == other.frequencies, "frequencies", other.frequencies,
                f"the same as {self.frequencies}")
        require(self.exposure is None and other.exposure is None, "exposure", problem="Windows do not add.")
        if not self.sensor.same_as(other.sensor):
            difference = first_difference(self.sensor, other.sensor)
            which = "{} {} and {}".format(*difference) if difference else "they differ only by rounding"
            raise InvalidInput("sensor", problem=f"Cannot add sketches of different sensors ({which}).")
        sums, photons = self.sums + other.sums, self.photons.astype(np.uint64) + other.photons
        if photons.max(initial=0) > MAX_PIXEL_PHOTONS:
            sums = sums * (MAX_PIXEL_PHOTONS / np.maximum(photons, MAX_PIXEL_PHOTONS))[..., None].astype(np.float32)
        cycles, before = added_cycles((self, other))
        return replace(self, sums=sums, photons=np.minimum(photons, MAX_PIXEL_PHOTONS).astype(np.uint32),
                       stamp_ns=min(self.stamp_ns, other.stamp_ns), cycles=cycles, before=before)

    def __radd__(self, nothing: int) -> Self:
        """For sum(), which begins with 0."""
        if nothing != 0:
            return NotImplemented
        return self

    def __getitem__(self, pixels: slice | tuple[slice, slice]) -> Self:
        """The sketch of a window of pixels; InvalidInput if none is in it."""
        rows, cols = pixels if isinstance(pixels, tuple) and len(pixels) == 2 else (pixels, slice(None))
        maps = {name: value[rows, cols] for name in MAPS if (value := getattr(self, name)) is not None}
        return replace(self, sums=self.sums[rows, cols], photons=self.photons[rows, cols],
                       sensor=self.sensor.cropped(rows, cols), **maps)


def added_cycles(sketches: Sequence[PhaseSums]) -> tuple[int, np.ndarray | None]:
    """`cycles` and `before` of a sum of sketches; cycles are 0 (not known) if any sketch has 0."""
    cycles = [sketch.cycles for sketch in sketches]
    counted = [sketch.before for sketch in sketches if sketch.before is not None]
    return sum(cycles) if all(cycles) else 0, sum(counted[1:], counted[0]) if counted else None


def noise_sketch(sensor: SensorModel, frequencies: tuple[int, ...]) -> PhaseSums:
    """A sketch of noise alone, for warming up."""
    rng = np.random.default_rng(0)
    sums = rng.normal(size=(*sensor.shape, len(frequencies), 2)).astype(np.float32)
    photons = np.full(sensor.shape, 9, np.uint32)
    return PhaseSums(frequencies, sums.view(np.complex64)[..., 0], photons, sensor=sensor)
