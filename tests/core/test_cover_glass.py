"""A plane in front of all pixels that hides the scene is said, by every method; a wall alone is not."""

import re

import numpy as np
import pytest

from srt3d_ros.photons import Photons

ROWS, COLS, T = 24, 30, 300
IRF = np.exp(-0.5 * (np.arange(-8, 9) / 1.5)**2)
WALL = 150 + 0.5 * np.arange(COLS) + np.zeros((ROWS, 1))


def photons(*surfaces, background=4, tail=0.0, shape=None, **options) -> Photons:
    """Photons of surfaces (depth in bins, photons a pixel), of which the share `tail` comes 20 bins late on average."""
    rng, pixel, toa = np.random.default_rng(0), [], []
    for depth, mean in (*surfaces, (None, background)):
        at = np.arange(ROWS * COLS).repeat(rng.poisson(mean, ROWS * COLS))
        pixel.append(at)
        late = rng.exponential(20, len(at)) * (rng.random(len(at)) < tail)
        toa.append(rng.choice(T, len(at), p=shape) if depth is None else
                   np.broadcast_to(depth, (ROWS, COLS)).reshape(-1)[at] + rng.normal(0, 1.5, len(at)) + late)
    pixel, toa = np.concatenate(pixel), np.rint(np.concatenate(toa)) % T
    return Photons.from_events(*np.divmod(pixel, COLS), toa, shape=(ROWS, COLS), num_bins=T, bin_width_s=1e-10,
                               toa_offset_bins=0, fov_deg=20, **{"irf": IRF} | options)


@pytest.mark.parametrize("method", ["pooled", "srt3d", "smle", "xcorr"])
def test_a_cover_glass_that_hides_a_wall_is_noted(method):
    note, = photons((20, 30), (WALL, 15)).reconstruct(method=method).notes
    assert re.search("pixels have their point at (0.29|0.3)", note) and "surfaces of 2" in note


def test_few_photons_show_it_too_and_two_surfaces_hide_nothing():
    assert len(photons((20, 2), (WALL, 1), background=1).reconstruct().notes) == 1
    assert photons((20, 30), (WALL, 15)).reconstruct(surfaces=2).notes == ()


def test_what_a_tail_leaves_behind_a_wall_is_said_with_both_causes():
    note, = photons((150, 10), tail=0.3).reconstruct().notes
    assert note.endswith("surfaces of 2 show what is behind; if it is a wall, the IRF lacks its tail")


@pytest.mark.parametrize(("surfaces", "options"), [
    ([(150, 30)], {}), ([(150, 300)], {"irf": np.exp(-0.5 * (np.arange(-8, 9) / 1.7)**2)}),     # a wall in front
    ([(WALL, 30)], {}), ([(np.where(WALL > 160, 200, 20), 30)], {})])
def test_a_wall_alone_and_scenes_at_several_depths_are_not(surfaces, options):
    assert photons(*surfaces, **options).reconstruct().notes == ()


DECAY = np.exp(-np.arange(T) / T) / np.exp(-np.arange(T) / T).sum()


@pytest.mark.parametrize("options", [
    {"background": 50, "shape": DECAY, "background_shape": DECAY},
    {"background": 60, "shape": DECAY, "cycles": 70}])                          # as pile-up of one photon a cycle
def test_a_wall_before_known_causes_of_other_photons_is_not(options):
    assert not any("cover glass" in note for note in photons((150, 10), **options).reconstruct().notes)
