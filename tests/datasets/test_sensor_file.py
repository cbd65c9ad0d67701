"""Sensors from files: the JSON of the `sensor` topic, photon files, config/sensors, and files that are neither."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.frequencies import choose_frequencies, irf_spectrum
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import open_sensor, photon_file
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor_message

SENSOR = SensorModel(2, 3, 50, 1e-10, np.array([1, 2, 1]), toa_offset_bins=7.5, gain=np.full((2, 3), 0.5),
                     projection=Pinhole(10, 11, 1, 0.5), gates=GateWords(3, 60_000), frame_id="spad")
NAMES = ["array_512x512", "scanner_141x141", "spad_32x32_gates"]


@pytest.mark.parametrize(("name", "encoding"), [("sensor.json", "utf-8"), ("SENSOR.JSON", "utf-8-sig")])
def test_the_text_of_the_sensor_topic_is_read(tmp_path, name, encoding):
    (tmp_path / name).write_text(sensor_message.to_json(SENSOR), encoding=encoding)
    assert open_sensor(str(tmp_path / name)).same_as(SENSOR)


def test_the_sensor_of_a_photon_file_is_read(tmp_path):
    photon_file.save(tmp_path / "a.npz", SENSOR, PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))
    assert open_sensor(tmp_path / "a.npz").same_as(SENSOR)


@pytest.mark.parametrize(("name", "content", "says"), [
    ("absent.json", None, "absent.json: no such file"),
    ("a.json", b"", "^a.json sensor is broken JSON"), ("a.json", b"\xff\xfe{", "^a.json is unreadable"),
    ("a.json", b"{}", "^a.json schema_version is absent"),
    ("a.txt", b"{}", "a.txt: expected a file that ends in .npz")])
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
