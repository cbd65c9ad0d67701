"""The published files, unmodified, agree photon for photon with the npz files made from them independently."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.datasets.options import ASSUMED_FOV
from srt3d_ros.photons import Photons

PAIRS = {
    "head": ("Face_Depth_Reflectivity_Clean.mat", "polystyrene_head_142_full.npz", {}),
    "two layers": ("two_layer.mat", "two_layer_100.npz", {}),
    "mannequin": ("data_face.mat", "mannequin_face_340.npz", {"gate": (3000, 5999)}),
    "tower": ("tower.mat", "tower_9p8km.npz", {}),
    "room": ("spad_0161_p1.mat", "room_64_10_50.npz", {}),
}


def sorted_photons(photons: Photons) -> np.ndarray:
    return np.sort(photons.frame.pixel.astype(np.int64) * 2**16 + photons.frame.toa)


def greatest_difference(irf: np.ndarray, reference: np.ndarray) -> float:
    """Between two IRFs once they are shifted onto each other, in units of the reference's peak."""
    padded = np.pad(reference, len(irf))
    shift = int(np.argmax(np.correlate(padded, irf)))
    padded[shift: shift + len(irf)] -= irf
    return np.abs(padded).max() / reference.max()


@pytest.mark.parametrize(("mat", "npz", "options"), PAIRS.values(), ids=PAIRS)
def test_published_file_and_npz_agree(shared_data, mat, npz, options):
    published = read(shared_data / "published" / mat, **options)
    made = read(shared_data / "photons" / npz)
    np.testing.assert_array_equal(sorted_photons(published), sorted_photons(made))
    for name in ("rows", "cols", "num_bins", "bin_width_s", "toa_offset_bins"):
        assert getattr(published.sensor, name) == getattr(made.sensor, name), name
    published.frame.check(published.sensor)
    assert published.frame.is_sorted
    assert any("bin width" in note for note in published.notes) and any("IRF" in note for note in published.notes)
    if mat.startswith("Face"):          # with the depths of its authors
        with np.load(shared_data / "photons" / npz) as file:
            np.testing.assert_array_equal(published.reference_depth_bins[0], file["ref_depth_bins"])
    assert greatest_difference(published.sensor.irf, made.sensor.irf) < 0.2


def test_every_npz_file_opens(shared_data):
    for path in sorted((shared_data / "photons").glob("*.npz")):
        photons = read(path)
        said = set(np.load(path).files)
        assert photons.frame.photons > 0 and photons.frame.is_sorted
        half_a_bin = [note for note in photons.notes if "toa_offset_bins is then 0.5" in note]
        assert bool(half_a_bin) == ("toa_offset_bins" not in said), path.name
        geometry = [] if {"projection", "fov_deg"} & said else [ASSUMED_FOV]
        assert [*photons.notes] == half_a_bin + geometry
