"""Tiles: the parts of an array too large for one reconstructor, whose points join without a seam.

A tile's points are those of its own pixels; it is reconstructed with the pixels around that have a say in them.
"""

from collections.abc import Callable
from dataclasses import dataclass

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import MAX_SIDE, SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.errors import InvalidInput, require

FORM = "empty for all, or row,col,rows,cols: 0,1,2,2 is the upper right one of 2 × 2 tiles"
# Pixels around a tile that are reconstructed with it. Windows, birth and death, and trimming one after the other reach
# farther, but farther pixels were not seen to change a bit of a cloud.
MARGIN = 60
CELLS = 6       # pixels: least common multiple of the cells of `constants.*_SCALES`, which have to lie as in the whole


@dataclass(frozen=True)
class Tile:
    """Tile (row, col), counted from 0, of the grid of rows × cols into which an array's pixels are shared out."""

    row: int = 0
    col: int = 0
    rows: int = 1
    cols: int = 1

    @classmethod
    def read(cls, text: str) -> "Tile":
        """The tile of a text such as "0,1,2,2", the whole array of an empty one; InvalidInput if it is neither."""
        if not text:
            return cls()
        try:
            row, col, rows, cols = (int(number) for number in text.strip("[]").split(","))
        except ValueError:
            raise InvalidInput("tile", text, FORM) from None
        require(0 <= row < rows and 0 <= col < cols, "tile", text, f"{FORM}; row below rows, col below cols")
        return cls(row, col, rows, cols)

    def pixels(self, rows: int, cols: int) -> tuple[slice, slice]:
        """Its rows and columns in an array of this size; each pixel of the array is in one tile of the grid.

        Raises:
            InvalidInput: more tiles than pixels.
        """
        require(self.rows <= rows and self.cols <= cols, "tile", ",".join(map(str, (
            self.row, self.col, self.rows, self.cols))), f"no more tiles than pixels, {rows} × {cols}")
        return tuple(slice(k * pixels // tiles, (k + 1) * pixels // tiles) for k, tiles, pixels in (
            (self.row, self.rows, rows), (self.col, self.cols, cols)))

    def window(self, rows: int, cols: int) -> tuple[slice, slice]:
        """Its rows and columns with the margin, as far as the array goes: what has to be reconstructed."""
        return tuple(slice(max(own.start - MARGIN, 0) // CELLS * CELLS, min(own.stop + MARGIN, pixels))
                     for own, pixels in zip(self.pixels(rows, cols), (rows, cols)))


class TileReconstruction:
    """Reconstructs the points of a tile, of the sketches of its window; with Tile() those of the whole array.

    Args:
        sensor: of the whole array.
        tile: which part of it.
        build: makes the reconstruction of a sensor, such as one of `methods`.

    Attributes:
        window: rows and columns of the array that it takes.
        own: rows and columns of the window that are the tile's.
        sensor: of the tile alone, which its clouds are of, finer pixels if it upsamples.
        first_pixel: row and column in the whole array of the first of the sensor's pixels.
    """

    def __init__(self, sensor: SensorModel, tile: Tile, build: Callable[[SensorModel], Callable]):
        size = sensor.rows, sensor.cols
        pixels, self.window = tile.pixels(*size), tile.window(*size)
        self.own = tuple(slice(part.start - around.start, part.stop - around.start)
                         for part, around in zip(pixels, self.window))
        self._inner = build(sensor.cropped(*self.window))
        if isinstance(self._inner, Pooled):
            self._inner.begin_at(*(around.start for around in self.window))
        self.device, factor = self._inner.device, getattr(self._inner, "upsampling", 1)
        require(max(size) * factor <= MAX_SIDE, "upsampling", factor,
                f"at most {MAX_SIDE // max(size)} with {sensor.rows} × {sensor.cols} pixels")
        self.sensor = sensor.cropped(*pixels).upsampled(factor)
        self.first_pixel = tuple(part.start * factor for part in pixels)
        self._kept = tuple(slice(part.start * factor, part.stop * factor) for part in self.own)

    def submit(self, sketch: Sketch) -> Callable[[], PointCloud]:
        """Begin with the sketch of the window; the function returned waits for the tile's cloud: see `Pooled`."""
        if isinstance(self._inner, Pooled):
            wait = self._inner.submit(sketch)
            return lambda: wait().cropped(*self._kept)
        cloud = self._inner(sketch).cropped(*self._kept)
        return lambda: cloud

    @property
    def uneven_background(self) -> float:
        """`Pooled.uneven_background`; 0 of other methods."""
        return getattr(self._inner, "uneven_background", 0.0)

    def warm_up(self) -> None:
        """Have the first frame be as fast as the others."""
        self._inner.warm_up()

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        if isinstance(self._inner, Pooled):
            self._inner.forget()
