"""Sketch: a few complex numbers a pixel in place of a frame's photons, with notes, to save and to reconstruct."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

from srt3d_ros.cloud import Cloud, notes_text
from srt3d_ros.core.methods import DEFAULT_METHOD, SKETCH_METHODS, find
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

    @classmethod
    def from_sums(cls, sums: PhaseSums, notes: tuple[str, ...] = ()) -> Self:
        """The sketch of plain sums."""
        return cls(**{field.name: getattr(sums, field.name) for field in fields(sums)} | {"notes": notes})

    def __repr__(self) -> str:
        return super().__repr__() + notes_text(self.notes)

    def save(self, path: str | Path) -> None:
        """Write the sketch with its sensor and notes as .npz, which `srt3d_ros.read` reads to the same bits.

        Raises:
            InvalidInput: another suffix, a path that cannot be written, or an .npz file there that is no sketch.
        """
        photon_file.save_sketch(path, self, self.notes)

    def reconstruct(self, *, method: str = DEFAULT_METHOD, surfaces: int = 1, device: str = "auto",
                    false_alarm_rate: float | None = None, background: str | None = None) -> Cloud:
        """The point cloud; arguments as for `Photons.reconstruct`, of a method on sketches."""
        wanted = f"one that takes sketches: {', '.join(SKETCH_METHODS)}"
        require(find(method).needs == "sketch", "method", method, wanted)
        reconstructor = Reconstructor(
            self.sensor, self.frequencies, method=method, surfaces=surfaces, device=device,
            false_alarm_rate=false_alarm_rate, background=background)
        return reconstructor(self)
