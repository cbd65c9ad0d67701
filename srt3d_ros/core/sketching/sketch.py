"""Sketch: what is kept of a frame's photons, and how sketches add."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.kernels.constants import MAX_PHOTONS, MAX_SKETCH_SIZE


def check_frequencies(frequencies: Sequence[int] | np.ndarray, num_bins: int) -> tuple[int, ...]:
    """The frequencies k_l as a tuple of different integers in [1, (T − 1) / 2], or InvalidInput.

    k and T − k carry the same information (one is the other's conjugate), k = 0 none but the photon count.
    """
    require(0 < len(frequencies) <= MAX_SKETCH_SIZE, "sketch size", len(frequencies),
            f"1 to {MAX_SKETCH_SIZE} frequencies")
    most = max((num_bins - 1) // 2, 1)
    for k in frequencies:
        require(1 <= k <= most and k == int(k), "frequencies", k,
                f"integers from 1 to {most} (T = {num_bins} bins; higher ones repeat these)")
    require(len(set(frequencies)) == len(frequencies), "frequencies", list(frequencies), "no frequency twice")
    return tuple(int(k) for k in frequencies)


@dataclass(frozen=True, eq=False)
class Sketch:
    """Per pixel, the sum over its photons of exp(i ω_l x_p), ω_l = 2π k_l / T, and their number.

    The paper's sketch is the mean, z_l = sums_l / n (eq. 3). Sums of disjoint sets of photons add.

    Args:
        frequencies: the integers k_l.
        sums: complex64 [rows, cols, m].
        photons: uint32 [rows, cols], n; MAX_PHOTONS and the mean where there were more.
        stamp_ns: start of acquisition of the earliest photons; of a window, of its newest frame.
        sensor: of the photons, behind the gate if there is one; None where it is not known.
        cycles: N, laser cycles that these photons are the first ones of; 0: not known, pile-up is not corrected.
        before: uint32 [rows, cols], photons that came before the gate, in cycles that were over with them; None: none.
    """

    frequencies: tuple[int, ...]
    sums: np.ndarray
    photons: np.ndarray
    stamp_ns: int = 0
    sensor: SensorModel | None = None
    cycles: int = 0
    before: np.ndarray | None = None

    def __post_init__(self) -> None:
        require(self.sums.ndim == 3 and self.sums.shape[2] == len(self.frequencies), "sketch shape", self.sums.shape,
                f"[rows, cols, {len(self.frequencies)}]")
        require(self.photons.shape == self.sums.shape[:2], "photons shape", self.photons.shape,
                f"[rows, cols] = {self.sums.shape[:2]}")

    @property
    def z(self) -> np.ndarray:
        """The paper's sketch, sums / n; complex64 [rows, cols, m], 0 where a pixel saw no photon."""
        each = 1 / np.maximum(self.photons, 1)[..., None].astype(np.float32)
        # as real numbers: complex ones take four times as long to divide
        return (np.ascontiguousarray(self.sums).view(np.float32) * each).view(np.complex64)

    @property
    def armed_cycles(self) -> np.ndarray:
        """Of the cycles, those in which a pixel could still see a photon in the sketch's bins; float64 [rows, cols]."""
        before = np.zeros(self.photons.shape) if self.before is None else self.before
        return np.maximum(self.cycles - before, self.photons).astype(np.float64)

    def __add__(self, other: "Sketch") -> Self:
        """The sketch of both sets of photons; InvalidInput unless frequencies and size agree."""
        require(self.frequencies == other.frequencies, "frequencies", other.frequencies,
                f"the same as {self.frequencies}")
        require(self.photons.shape == other.photons.shape, "sketch size", other.photons.shape,
                f"the same as {self.photons.shape}")
        sums, photons = self.sums + other.sums, self.photons.astype(np.uint64) + other.photons
        if photons.max(initial=0) > MAX_PHOTONS:
            sums = sums * (MAX_PHOTONS / np.maximum(photons, MAX_PHOTONS))[..., None].astype(np.float32)
        cycles, before = added_cycles((self, other))
        return replace(self, sums=sums, photons=np.minimum(photons, MAX_PHOTONS).astype(np.uint32),
                       stamp_ns=min(self.stamp_ns, other.stamp_ns), cycles=cycles, before=before)


def added_cycles(sketches: Sequence[Sketch]) -> tuple[int, np.ndarray | None]:
    """`cycles` and `before` of a sum of sketches; the cycles are known if all of theirs are."""
    cycles = [sketch.cycles for sketch in sketches]
    counted = [sketch.before for sketch in sketches if sketch.before is not None]
    return sum(cycles) if all(cycles) else 0, sum(counted[1:], counted[0]) if counted else None


def noise_sketch(sensor: SensorModel, frequencies: tuple[int, ...]) -> Sketch:
    """A sketch that shows nothing."""
    rng = np.random.default_rng(0)
    sums = rng.normal(size=(sensor.rows, sensor.cols, len(frequencies), 2)).astype(np.float32)
    return Sketch(frequencies, sums.view(np.complex64)[..., 0], np.full((sensor.rows, sensor.cols), 9, np.uint32))
