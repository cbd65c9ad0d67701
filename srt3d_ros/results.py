"""Cloud and Sketch: what the library gives, with the sensor that it belongs to."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from srt3d_ros.core import sketch as core_sketch
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import sketch_file
from srt3d_ros.errors import InvalidInput, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image


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
        text = (f"Cloud of {len(self):,} points{where}, from {self.facts.get('photons', 0):,} photons of "
                f"{self.sensor.rows} × {self.sensor.cols} pixels")
        return "\n".join([text, *self.notes])

    def save(self, path: str | Path) -> None:
        """Write the cloud by the suffix: .npz (everything), .ply, .pcd, .rrd (opens in rerun); or draw it: .png, .jpg.

        Raises:
            InvalidInput: another suffix, or a path that cannot be written.
        """
        from srt3d_ros.recording import cloud_files

        cloud_files.save(self, path, frequencies=tuple(self.facts.get("frequencies", ())), sensor=self.sensor)

    def plot(self, path: str | Path | None = None, ax: "Axes | None" = None, *, yaw_deg: float = -20,
             pitch_deg: float = 10, size_px: tuple[int, int] = (1200, 900)) -> "Image":
        """The cloud as a picture: coloured by range, shaded by intensity, with a scale bar.

        Args:
            path: where to write it, if given: .png, .jpg, ….
            ax: of matplotlib, to draw it into, if given.
            yaw_deg, pitch_deg: from where it is seen: to the right of the sensor and above it.
            size_px: width and height of the picture.

        Returns:
            A Pillow image, which a notebook shows.

        Raises:
            InvalidInput: a path that cannot be written, or matplotlib or Pillow is missing.
        """
        try:
            from srt3d_ros.pictures import annotations
        except ImportError as error:
            raise InvalidInput("plot", f"{error}", "pip install 'srt3d_ros[review]' to have been run") from None

        require(min(size_px) > 0, "size_px", size_px, "width and height, above 0")
        image = annotations.draw_cloud(self, self.sensor, yaw_deg, pitch_deg, size_px)
        if ax is not None:
            ax.imshow(image)
            ax.set_axis_off()
        if path is not None:
            try:
                image.save(path)
            except (OSError, ValueError) as error:
                raise InvalidInput("picture", str(path), f"a file that can be written ({error})") from None
        return image


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

    def __repr__(self) -> str:
        rows, cols, m = self.sums.shape
        text = f"Sketch of {self.photons.sum():,} photons, {m} numbers in each of {rows} × {cols} pixels"
        return "\n".join([text, *self.notes])

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
        sensor = self.sensor.cropped(rows, cols)
        return replace(super().__getitem__((rows, cols)), sensor=sensor)

    def save(self, path: str | Path) -> None:
        """Write an .npz sketch file (docs/photon-file.md)."""
        sketch_file.save(path, self, self.sensor)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read an .npz sketch file."""
        found, sensor = sketch_file.read(path)
        return cls(**vars(found), sensor=sensor)
