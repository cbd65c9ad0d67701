"""Tiles: that they share an array out, and that their clouds together are that of the whole array."""

import numpy as np
import pytest

from srt3d_ros.core import tiles
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.core.tiles import CELLS, MARGIN, Tile, TileReconstruction
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels.constants import REST_SCALES, SLANTED, SURE_SCALES
from tests.core.scenes import make_sensor, ramp, simulate

FIELDS = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")


def all_tiles(rows: int, cols: int) -> list[Tile]:
    return [Tile(row, col, rows, cols) for row in range(rows) for col in range(cols)]


@pytest.mark.parametrize("rows, cols, grid", [(1024, 1024, (2, 2)), (277, 348, (3, 5)), (7, 1, (7, 1)), (9, 9, (1, 1))])
def test_each_pixel_is_in_one_tile_and_windows_have_the_margin_and_whole_cells(rows, cols, grid):
    times = np.zeros((rows, cols), int)
    for tile in all_tiles(*grid):
        times[tile.pixels(rows, cols)] += 1
        for own, around, pixels in zip(tile.pixels(rows, cols), tile.window(rows, cols), (rows, cols)):
            assert around.start % CELLS == 0 and 0 <= around.start <= max(own.start - MARGIN, 0)
            assert around.stop == min(own.stop + MARGIN, pixels) and own.start - around.start < MARGIN + CELLS
    assert (times == 1).all()
    assert all(CELLS % size == 0 for _, size in (*SURE_SCALES, *REST_SCALES, SLANTED))


@pytest.mark.parametrize("text", ["0,0,2", "2,0,2,2", "-1,0,2,2", "0,0,2,2.5", "off"])
def test_what_is_no_tile_is_named(text):
    with pytest.raises(InvalidInput, match=f"^tile is {text}: expected empty for all, or row,col,rows,cols"):
        Tile.read(text)
    assert Tile.read("") == Tile(0, 0, 1, 1) and Tile.read("0,1,2,3") == Tile.read("[0, 1, 2, 3]") == Tile(0, 1, 2, 3)


def test_more_tiles_than_pixels_are_refused():
    with pytest.raises(InvalidInput, match="^tile is 0,0,2,9: expected no more tiles than pixels, 40 × 8"):
        Tile(0, 0, 2, 9).window(40, 8)


# ---- Clouds

def scene(**changes):
    """A sketch of two walls that meet in a step off the seams, the right one steep, and its sensor."""
    sensor = make_sensor(156, 168, **changes)
    depth = np.where(np.arange(168) < 70, 200.0, ramp(156, 168, 0, 3.0, 1.0) % 586)
    depth[90:130, 20:110] = 120
    frequencies = choose("auto", sensor, 10)
    return sketch_photons(simulate(depth, 2.0, 1.0, sensor, seed=1), sensor, frequencies), sensor


def reconstruct(sketch, sensor, tile=Tile(), **options):
    """The tile's cloud, with row and col of the whole array."""
    part = TileReconstruction(sensor, tile, lambda cut: Pooled(cut, sketch.frequencies, device="cpu", **options))
    cloud = part.submit(sketch[part.window])()
    assert cloud.background.shape == (part.sensor.rows, part.sensor.cols)
    return {name: getattr(cloud, name) + (part.first_pixel[name == "col"] if name in ("row", "col") else 0)
            for name in FIELDS}


def joined(clouds: list[dict]) -> dict:
    """The points of all tiles, in the order of a whole cloud."""
    together = {name: np.concatenate([cloud[name] for cloud in clouds]) for name in FIELDS}
    order = np.lexsort([together[name] for name in ("surface", "col", "row")])
    return {name: values[order] for name, values in together.items()}


@pytest.mark.parametrize("options", [{}, {"upsampling": 2}, {"surfaces": 2}])
def test_the_clouds_of_all_tiles_are_the_cloud_of_the_array_without_a_gap_a_seam_or_a_point_twice(options):
    sketch, sensor = scene(mask=np.random.default_rng(1).random((156, 168)) > 0.02)
    whole = reconstruct(sketch, sensor, **options)
    parts = joined([reconstruct(sketch, sensor, tile, **options) for tile in all_tiles(2, 2)])
    for name in FIELDS:
        np.testing.assert_array_equal(parts[name], whole[name], err_msg=name)
    assert len(whole["row"]) > 0.97 * sensor.mask.sum() * options.get("upsampling", 1)**2


def test_without_a_margin_there_is_a_seam(monkeypatch):
    sketch, sensor = scene()
    monkeypatch.setattr(tiles, "MARGIN", 0)
    whole, parts = reconstruct(sketch, sensor), joined([reconstruct(sketch, sensor, tile) for tile in all_tiles(1, 2)])
    off = dict(zip(zip(parts["row"], parts["col"]), parts["depth_bins"]))
    moved = [abs(col - 83.5) for row, col, depth in zip(whole["row"], whole["col"], whole["depth_bins"])
             if abs(off.get((row, col), np.inf) - depth) > 0.1]
    assert len(moved) > 100 and np.median(moved) < 10
