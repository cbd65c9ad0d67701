"""`sensor`: every field makes the trip, and every way to get it wrong is one line that names the field."""

import base64
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput
from srt3d_ros.files import json_text
from srt3d_ros.messages import sensor_message as sensor
from srt3d_ros.messages.schema_files import load

GOLDEN = Path(__file__).parent / "golden"
FULL = SensorModel(
    rows=2, cols=3, num_bins=100, bin_width_s=2.5e-10, irf=np.array([0, 1, 2, 1], np.float32), irf_ref=1,
    toa_offset_bins=7.25, range_offset_m=-0.125, gain=np.linspace(0.5, 1.5, 6).reshape(2, 3),
    delay_bins=np.arange(6).reshape(2, 3) / 8, mask=np.array([[True, False, True], [True, True, True]]),
    projection=AngularScan(0.5, -0.25, 0.125, -0.0625), gates=GateWords(1, 0), frame_id="spad_optical")


def plain() -> dict:
    """The least that a driver may say, without base64."""
    return {"schema_version": 1, "rows": 2, "cols": 3, "num_bins": 100, "bin_width_s": 1e-10, "irf": [1, 2, 1.5]}


def refused(content) -> InvalidInput:
    text = content if isinstance(content, str) else json.dumps(content)
    with pytest.raises(InvalidInput) as caught:
        sensor.from_json(text)
    assert len(str(caught.value).splitlines()) == 1
    return caught.value


@pytest.mark.parametrize(("name", "content"), [
    ("sensor", FULL),
    ("sensor_lens", FULL.replace(projection=Pinhole(10.5, 11.5, 1.0, 0.5, PlumbBob(-0.25, 0.125, 0.5, -0.5, 0.01)))),
    ("sensor_histograms", FULL.replace(gates=None, histograms=HistogramBins(
        4, 0.5, 1.5, np.array([3, 1.5, 0, 0], np.float32))))])
def test_text_is_the_golden_one(name, content):
    golden = (GOLDEN / f"{name}.json").read_text()
    assert sensor.to_json(content) == golden.strip()
    assert sensor.from_json(golden).same_as(content)
    Draft202012Validator(load("sensor")).validate(json.loads(golden))


@pytest.mark.parametrize("changes", [
    {"gain": None, "delay_bins": None, "mask": None, "gates": None, "cycles": 1504,
     "extrinsics": "0 0 1 0 0 0 1"},
    {"irf": np.random.default_rng(3).random((6, 100)), "irf_ref": 99, "background_shape": np.arange(100)}])
def test_optional_parts_make_the_trip(changes):
    content = FULL.replace(**changes)
    assert sensor.decode_cdr(sensor.encode_cdr(content)).same_as(content)


def test_plain_lists_defaults_and_keys_of_the_drivers_own_are_taken():
    content = plain() | {"gain": [[1, 1, 1], [2, 2, 2]], "mask": [[True, True, False], [True] * 3],
                         "x_serial": "A-17", "x_temperature": {"c": 21}}
    model = sensor.from_json(json.dumps(content))
    assert model.irf.tolist() == pytest.approx([1 / 4.5, 2 / 4.5, 1.5 / 4.5])
    assert sensor.from_json(json.dumps(content | {"rows": 2.0})).rows == 2      # a whole number, however written
    assert model.irf_ref == 1 and model.frame_id == "lidar" and isinstance(model.projection, Pinhole)
    assert model.gain[1].tolist() == [2, 2, 2] and model.mask[0].tolist() == [True, True, False]


def test_distortion_is_written_by_its_names_and_only_where_there_is_some():
    lens = Pinhole(10.5, 11.5, 1.0, 0.5, PlumbBob(k1=-0.25, p2=0.125))
    written = sensor.to_object(FULL.replace(projection=lens))["projection"]
    assert written["distortion"] == {"k1": -0.25, "k2": 0, "p1": 0, "p2": 0.125, "k3": 0}
    del written["distortion"]["k3"]         # what OpenCV calls four coefficients
    assert sensor.from_json(json.dumps(plain() | {"projection": written})).projection == lens
    assert "distortion" not in sensor.to_object(FULL.replace(projection=Pinhole(9, 9, 1, 1)))["projection"]


def lens(**changes) -> dict:
    return {"kind": "pinhole", "fx": 3, "fy": 3, "cx": 1, "cy": 0.5} | changes


def packed(**changes) -> dict:
    return {"dtype": "float32", "shape": [2], "base64": base64.b64encode(np.ones(2, "<f4")).decode()} | changes


@pytest.mark.parametrize(("changes", "said"), [       # what SensorModel itself refuses: tests/core/sensor/test_model.py
    ({"schema_version": None}, "schema_version is absent"), ({"schema_version": 2}, "schema_version is 2: expected 1"),
    ({"rows": None}, "rows is absent"), ({"rows": "2"}, 'rows is "2": expected an integer'),
    ({"rows": 10**400}, "rows is 1000"), ({"toa_offset_bins": "3"}, 'toa_offset_bins is "3": expected a finite number'),
    ({"irf": [[1, 2], [1]]}, "irf has lists of unequal length"), ({"irf": [1, True]}, "irf is True"),
    ({"irf": ["1", 2]}, 'irf is "1": expected nested lists'), ({"irf": [1, 10**400]}, "irf has lists of"),
    ({"mask": [[1, 1, 1], [0, 1, 1]]}, "mask is 1"),
    ({"irf": {"shape": [2], "base64": ""}}, "irf.dtype is absent: expected float32"),
    ({"irf": packed(dtype="float64")}, "irf.dtype is"),
    ({"irf": packed(shape=[2**62, 2**62])}, "irf.base64 is 8 bytes"),
    ({"irf": packed(shape=[-2])}, "irf.shape is [-2]: expected a list of one or two sizes"),
    ({"irf": packed(base64="ÄÖ")}, "irf.base64 is broken"),
    ({"mask": packed(dtype="bool", shape=[2, 3], base64=base64.b64encode(bytes([0, 1, 2, 1, 1, 1])).decode())},
     "mask has bytes other than 0 and 1"),
    ({"rows\n\u20283": 1}, 'unknown key is "rows 3": expected'),
    ({"kind": "pinhole"}, 'unknown key is "kind"'), ({"irf": packed(order="C")}, 'irf.unknown key is "order"'),
    ({"gates": {"first_word": 0, "no_detection": 1, "schema_version": 1}}, 'gates.unknown key is "schema_version"'),
    ({"projection": {"fx": 1}}, "projection.kind is absent"),
    ({"projection": {"kind": "lens"}}, 'projection.kind is "lens": expected pinhole or '),
    ({"projection": lens(distortion={"k1": 0, "k2": 0, "p2": 0})}, "projection.distortion.p1 is absent"),
    ({"projection": lens(distortion=dict.fromkeys(["k1", "k2", "p1", "p2", "k4"], 0))},
     'projection.distortion.unknown key is "k4"'),
    ({"gates": {"first_word": 0}}, "gates.no_detection is absent"),
    ({"frame_id": "a\0b"}, "frame_id is"),
])
def test_malformed_sensor_gives_one_error_that_names_the_field(changes, said):
    error = refused({key: value for key, value in (plain() | changes).items() if value is not None})
    assert str(error).startswith(said)


PLAIN = json.dumps(plain())


@pytest.mark.parametrize(("text", "said"), [
    ("", "sensor is broken JSON"), ("hello", "sensor is broken JSON"), ("[1]", "sensor is list"),
    ('{"rows": 1' + "0" * 5000 + "}", "sensor is broken JSON"), ('{"rows":' * 100_000, "sensor is broken JSON"),
    (PLAIN.replace("1e-10", "NaN"), "JSON is NaN"), (PLAIN.replace("1e-10", "-Infinity"), "JSON is -Infinity"),
    (PLAIN.replace("1e-10", "1e999"), "bin_width_s is"),
    ('{"rows": 3, ' + PLAIN[1:], 'repeated key is "rows": expected each key of an object once')],
    ids=range(9))
def test_broken_json_gives_one_error(text, said):
    assert str(refused(text)).startswith(said)


def test_long_texts_take_no_more_memory_than_the_message_and_sizes_are_bounded_before_parsing(monkeypatch):
    text = json.dumps(plain() | {"irf": ["x" * 100_000] + [""] * 100_000})
    tracemalloc.start()
    assert refused(text).field == "irf"
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * len(text)
    monkeypatch.setattr(json_text.json, "loads", lambda *args, **kwargs: pytest.fail("parsed"))
    assert "67108865 bytes" in str(refused(" " * (json_text.MAX_JSON_BYTES + 1)))
    assert "base64" in str(refused("[" + "0," * 2**20 + "0]"))
