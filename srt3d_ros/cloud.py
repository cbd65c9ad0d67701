"""Cloud: the points of a frame with notes, to save and to draw: what a reconstruction returns."""

import html
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.datasets import cloud_files
from srt3d_ros.errors import InvalidInput, quoted, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Noun = TypeVar("Noun")
NOTEBOOK_PX = 320, 240
NOTEBOOK_COLOURS = 64       # 6 bits a pixel: such a picture takes less than 60 kB whatever it shows


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(PointCloud):
    """The points of one frame, sorted by pixel, the strongest of a pixel first, to save and to draw.

    Args:
        row, col, depth_bins, …: as of `core.point_cloud.PointCloud`.
        notes: one line each for what was assumed, estimated or left out.
    """

    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return super().__repr__() + notes_text(self.notes)

    def _repr_html_(self) -> str:
        """For notebooks: the text with a picture below it; the text alone if a package for drawing is missing."""
        text = f"<pre>{html.escape(repr(self))}</pre>"
        try:
            from srt3d_ros.pictures.annotations import draw_cloud
            from srt3d_ros.pictures.figures import data_uri
        except ImportError:
            return text
        picture = draw_cloud(self, size_px=NOTEBOOK_PX).convert("RGB")
        uri = data_uri(picture.quantize(NOTEBOOK_COLOURS), "png", optimize=True)
        return f'{text}<img alt="" src="{uri}">'

    def save(self, path: str | Path) -> None:
        """Write the cloud by the suffix: .npz (everything), .ply, .pcd, .csv, .tif (the depth image), .html (to
        turn in any browser); or draw it: .png, .jpg.

        Raises:
            InvalidInput: another suffix, a path that cannot be written, or an .npz file there that is no cloud.
        """
        cloud_files.save(self, path, self.notes)

    def to_records(self) -> np.ndarray:
        """The points as a structured array [N], as `pandas.DataFrame` takes it: x, y, z (metres), intensity (photons),
        depth_std (metres), background (photons of the pixel), row, col and surface (0 for the first of its pixel)."""
        return cloud_files.records(self)

    def plot(self, colour_by: str = "range", ax: "Axes | None" = None, *, yaw_deg: float = 15, pitch_deg: float = 10
             ) -> "Axes":
        """Draw the cloud into axes of matplotlib, with a scale bar.

        Args:
            colour_by: what colours show: "range", shaded by intensity; "intensity", "depth_std" (mm), or "snr", the
                point's signal photons over the standard deviation of all photons in its pulse.
            ax: to draw into; those of a new figure unless given.
            yaw_deg, pitch_deg: from where it is seen: to the right of the sensor and above it.

        Raises:
            InvalidInput: matplotlib or Pillow is missing, or the method gives no such quantity.
        """
        image = self.render(colour_by, yaw_deg=yaw_deg, pitch_deg=pitch_deg)
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.figure().add_axes((0, 0, 1, 1))
        ax.imshow(image)
        ax.set_axis_off()
        return ax

    def render(self, colour_by: str = "range", *, yaw_deg: float = 15, pitch_deg: float = 10,
               size_px: tuple[int, int] = (1200, 900)) -> np.ndarray:
        """The cloud as a picture, uint8 [height, width, 3]; `save` writes one to a file.

        Args:
            colour_by, yaw_deg, pitch_deg: see `plot`.
            size_px: width and height of the picture.

        Raises:
            InvalidInput: as for `plot`.
        """
        fits = isinstance(size_px, tuple) and all(isinstance(side, int) and side > 0 for side in size_px)
        require(fits and len(size_px) == 2, "size_px", quoted(size_px), "(width, height), above 0")
        try:
            from srt3d_ros.pictures.annotations import draw_cloud
        except ImportError as error:
            problem = f"Cannot draw a cloud: {error.name} is missing (pip install '.[pictures]' in the clone)."
            raise InvalidInput("picture", problem=problem) from None
        return np.array(draw_cloud(self, yaw_deg, pitch_deg, size_px, colour_by).convert("RGB"))


def as_noun(kind: type[Noun], plain: Any, **changes: Any) -> Noun:
    """Plain points or sums of a frame as a Cloud or a Sketch, with other values of some fields."""
    return kind(**{field.name: getattr(plain, field.name) for field in fields(plain)} | changes)


def notes_text(notes: Sequence[str]) -> str:
    """The end of a text: "; 2 notes", or nothing."""
    return f"; {len(notes)} note{'s' if len(notes) > 1 else ''}" if notes else ""
