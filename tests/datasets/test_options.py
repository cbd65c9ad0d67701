"""Options win over the file."""

import numpy as np
import pytest

from srt3d_ros import api, read
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import photon_file
from srt3d_ros.errors import InvalidInput

IRF = np.array([1, 2, 1], np.float32) / 4


@pytest.fixture
def path(tmp_path):
    sensor = SensorModel(2, 3, 50, 1e-10, IRF, irf_ref=0, toa_offset_bins=7)
    events = PhotonEvents(np.array([5, 0, 3], np.uint32), np.array([49, 0, 7], np.uint16))
    reference = np.array([[10, 20, np.nan], [30, 12, 49]], np.float32)
    photon_file.save(tmp_path / "a.npz", sensor, events, reference)
    return tmp_path / "a.npz"


def test_options_win_over_the_sensor_and_over_the_file(path):
    np.save(path.with_name("response.npy"), np.array([1.0, 1, 1, 5]))
    own = read(path).sensor.replace(num_bins=60, bin_width_s=2e-10)
    sensor = read(path, sensor=own, num_bins=70, irf=path.with_name("response.npy"), irf_ref=1).sensor
    assert (sensor.num_bins, sensor.bin_width_s, sensor.toa_offset_bins) == (70, 2e-10, 7)
    np.testing.assert_allclose(sensor.irf, [0.125, 0.125, 0.125, 0.625])
    assert sensor.irf_ref == 1
    other = read(path, num_bins=70, irf=[0, 1, 5, 1], gain=np.full((2, 3), 2))
    assert other.sensor.irf_ref == 2 and (other.sensor.gain == 2).all()     # an IRF comes with its own reference
    assert other.notes == ("as given, not as in the file: num_bins, irf",)      # it has no gain


def test_num_bins_of_the_caller_decides_which_photons_are_outside(path):
    shorter = read(path, num_bins=40)
    assert shorter.frame.toa.tolist() == [0, 7] and shorter.sensor.num_bins == 40
    replaced = "as given, not as in the file: num_bins"
    assert {replaced, "1 of 3 photons lie outside 0 to below 40 bins: dropped"} == {*shorter.notes}
    arrays = dict(np.load(path)) | {"num_bins": 20}
    np.savez(path, **arrays)
    assert read(path).frame.toa.tolist() == [0, 7]
    assert read(path, num_bins=50).frame.toa.tolist() == [49, 0, 7] and read(path, num_bins=50).notes == (replaced,)
    assert api.read(read(path, num_bins=50), num_bins=40).frame.toa.tolist() == [0, 7]


def test_a_gate_moves_toa_offset_and_reference_together(path):
    photons = read(path, gate=[5, 24])
    assert photons.frame.toa.tolist() == [2] and photons.frame.pixel.tolist() == [3]
    assert photons.sensor.num_bins == 20 and photons.sensor.toa_offset_bins == 12
    expected = [[5, 15, np.nan], [np.nan, 7, np.nan]]
    np.testing.assert_array_equal(photons.reference_depth_bins, [expected])
    assert photons.notes == ("2 of 3 photons lie outside the gate (bins 5 to 24): dropped",)
    whole = read(path)
    assert photons.sensor.range_m(5) == pytest.approx(whole.sensor.range_m(10))


@pytest.mark.parametrize(("field", "options"), [
    ("gate", {"gate": (40, 20)}), ("gate", {"gate": (3,)}), ("gate", {"gate": (-1, 20)}), ("gate", {"gate": (0.5, 20)}),
    ("a.npz toa", {"num_bins": 7}), ("rows", {"rows": 3}), ("option name", {"width": 3}),
    ("irf", {"irf": "response.bin"}),
    ("irf dtype", {"irf": ["a"]}), ("irf shape", {"irf": np.ones((2, 2, 2))}), ("fov_deg", {"fov_deg": "wide"}),
    ("channel", {"channel": 1}), ("frame", {"frame": 1}), ("a.npz num_bins", {"num_bins": "many"}),
    ("gate", {"gate": (10**400, 2)}),
    ("irf", {"irf": "a" * 300 + ".npy"}), ("irf", {"irf": "absent.npy"}), ("gate", {"gate": 3}),
    ("gate", {"gate": "off"}), ("irf_sigma_bins", {"irf_sigma_bins": "w"}), ("irf_sigma_bins", {"irf_sigma_bins": 0})])
def test_unusable_options_are_named(path, field, options):
    with pytest.raises(InvalidInput) as caught:
        read(path, **options)
    assert caught.value.field == field
