"""Sketch: a few complex numbers a pixel in place of a frame's photons, with notes, to save and to reconstruct."""

from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from srt3d_ros.cloud import Cloud, notes_text
from srt3d_ros.core.free_space import FreeSpace
from srt3d_ros.core.keys import written_out
from srt3d_ros.core.methods import DEFAULT_METHOD, SKETCH_METHODS, MethodOptions
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets import photon_file
from srt3d_ros.errors import require
from srt3d_ros.reconstruction import Reconstructor


@dataclass(frozen=True, eq=False, repr=False)
class Sketch(PhaseSums):
    """What a frame's photons leave in each pixel, to save and to reconstruct; sketches of the same frequencies add.

    Args:
        frequencies, sums, photons, stamp_ns, cycles, before, sensor: as of `core.sketching.sums.PhaseSums`.
        notes: one line each for what was assumed, estimated or left out.

    Raises:
        InvalidInput: naming the argument that cannot be used.
    """

    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return super().__repr__() + notes_text(self.notes)

    def save(self, path: str | Path) -> None:
        """Write the sketch with its sensor and notes as .npz, which `srt3d_ros.read` reads to the same bits.

        Raises:
            InvalidInput: another suffix, a path that cannot be written, or an .npz file there that is no sketch.
        """
        photon_file.save_sketch(path, self, self.notes)

    @written_out(MethodOptions)
    def reconstruct(self, **options: Unpack[MethodOptions]) -> Cloud:
        """The point cloud, by a method that takes sketches."""
        method = options.get("method", DEFAULT_METHOD)
        require(method in SKETCH_METHODS, "method", method, f"one that takes sketches: {', '.join(SKETCH_METHODS)}")
        return Reconstructor(self.sensor, self.frequencies, **options)(self)

    def free_range_m(self, cloud: Cloud, *, brightness: float, max_range_m: float = 0.0) -> np.ndarray:
        """The range up to which each pixel without a point is empty, from this frame alone: docs/algorithm.md.

        A pixel that is dead, or covered, counts as dark and claims the most: for streams, take a `FreeSpaceStream`.

        Args:
            cloud: that `reconstruct` made of this sketch, with all its points.
            brightness: signal photons that the darkest object of interest sends into a pixel in a frame from 1 m.
            max_range_m: no claim exceeds it; 0 = the end of the period or gate.

        Returns:
            float32 [rows, cols], metres; NaN where a pixel has a point, is masked, or cannot say.

        Raises:
            InvalidInput: the brightness is not above 0, or the cloud is not of this sketch.
        """
        return FreeSpace(self.sensor, self.frequencies).range_m(self, cloud, brightness, max_range_m)
