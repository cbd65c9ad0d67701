"""Options win over the file, and sensors have files of their own."""

import numpy as np
import pytest

from srt3d_ros import api, read
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.frequencies import choose_frequencies, irf_spectrum
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import open_sensor, photon_file
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor_message

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
    ("a.npz toa", {"num_bins": 7}), ("a.npz rows", {"rows": 3}), ("option name", {"width": 3}),
    ("irf", {"irf": "response.bin"}),
    ("irf dtype", {"irf": ["a"]}), ("irf shape", {"irf": np.ones((2, 2, 2))}), ("a.npz fov_deg", {"fov_deg": "wide"}),
    ("a.npz channel", {"channel": 1}), ("frame", {"frame": 1}), ("a.npz num_bins", {"num_bins": "many"}),
    ("gate", {"gate": (10**400, 2)}),
    ("irf", {"irf": "a" * 300 + ".npy"}), ("irf", {"irf": "absent.npy"}), ("gate", {"gate": 3}),
    ("gate", {"gate": "off"}), ("irf_sigma_bins", {"irf_sigma_bins": "w"}), ("irf_sigma_bins", {"irf_sigma_bins": 0})])
def test_unusable_options_are_named(path, field, options):
    with pytest.raises(InvalidInput) as caught:
        read(path, **options)
    assert caught.value.field == field


SENSOR = SensorModel(2, 3, 50, 1e-10, np.array([1, 2, 1]), toa_offset_bins=7.5, gain=np.full((2, 3), 0.5),
                     projection=Pinhole(10, 11, 1, 0.5), gates=GateWords(3, 60_000), frame_id="spad")
NAMES = ["array_512x512", "scanner_141x141", "spad_32x32_gates"]


def test_the_text_of_the_sensor_topic_and_photon_files_give_their_sensor(tmp_path):
    photon_file.save(tmp_path / "a.npz", SENSOR, PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))
    for name, encoding in (("sensor.json", "utf-8"), ("SENSOR.JSON", "utf-8-sig")):
        (tmp_path / name).write_text(sensor_message.to_json(SENSOR), encoding=encoding)
    assert all(open_sensor(str(path)).same_as(SENSOR) for path in tmp_path.iterdir())


@pytest.mark.parametrize(("name", "content", "says"), [
    ("absent.json", None, "absent.json: no such file"),
    ("a.json", b"", "^a.json sensor is broken JSON"), ("a.json", b"\xff\xfe{", "^a.json is unreadable"),
    ("a.json", b"{}", "^a.json schema_version is absent"),
    ("a.doc", b"{}", "a.doc: expected a file that ends in .npz")])
def test_what_cannot_be_used_is_named_in_one_line(tmp_path, name, content, says):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=says) as caught:
        open_sensor(tmp_path / name)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", NAMES)
def test_the_sensors_of_config_open_and_can_be_sketched(repository, name):
    sensor = open_sensor(repository / "config" / "sensors" / f"{name}.json")
    frequencies = choose_frequencies("auto", sensor, 10)
    assert len(frequencies) == 10 and np.abs(irf_spectrum(sensor, frequencies)).min() > 0.1
    assert np.isfinite(sensor.rays).all() and sensor.range_m(sensor.num_bins) > sensor.range_m(0) >= 0
    assert (sensor.frame_id == "spad_optical") == isinstance(sensor.projection, Pinhole)        # REP-103
