"""`sketch`: precision, shapes, and that a message names its frequencies, T and the description it belongs to."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor_message
from srt3d_ros.messages import sketch_message as sketch
from srt3d_ros.messages.cdr import CloudMessage
from tests.messages.conftest import CODECS, SENSOR

LAYOUTS = ["float32", "int16"]


def random_sketch(seed: int, rows: int, cols: int, m: int) -> tuple[PhaseSums, SensorModel]:
    """A sketch of true photons, 0 to 4 in each pixel, and their sensor."""
    rng = np.random.default_rng(seed)
    photons = rng.integers(0, 5, (rows, cols)).astype(np.uint32)
    phases = rng.uniform(0, 2 * np.pi, (rows, cols, m, 4))
    seen = np.arange(4) < photons[..., None, None]
    frequencies = tuple(rng.permutation(np.arange(1, 50))[:m].tolist())
    sums = (np.exp(1j * phases) * seen).sum(axis=-1).astype(np.complex64)
    sensor = SensorModel(rows, cols, 100, 1e-10, np.ones(3))
    return PhaseSums(frequencies, sums, photons, seed, sensor=sensor), sensor


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32), rows=st.integers(1, 9), cols=st.integers(1, 9), m=st.integers(1, 12),
       layout=st.sampled_from(LAYOUTS))
def test_any_sketch_makes_the_trip(seed, rows, cols, m, layout):
    content, sensor = random_sketch(seed, rows, cols, m)
    rounding = {"float32": 1e-6, "int16": 0.5 / 32_767 + 1e-6}[layout] * content.photons
    raw = sketch.encode_cdr(content, "spad", layout)
    header, back = sketch.decode_cdr(raw, sensor)
    assert (header.stamp_ns, header.frame_id, back.stamp_ns) == (seed, "spad", seed)
    assert back.frequencies == content.frequencies and (back.photons == content.photons).all()
    assert back.sensor is sensor and sketch.description_of(CloudMessage.read(raw)) == sensor_message.digest(sensor)
    error = np.abs((back.sums - content.sums).view(np.float32)).reshape(rows, cols, -1)
    assert (error <= rounding[..., None]).all()
    assert (back.sums[content.photons == 0] == 0).all()
    same_header, frequencies, counts = sketch.decode_counts_cdr(raw)
    assert (same_header, frequencies) == (header, content.frequencies) and (counts == content.photons).all()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_cycles_and_the_photons_before_a_gate_make_the_trip_where_they_are_known(layout):
    content, sensor = random_sketch(1, 3, 4, 5)
    before = np.arange(12, dtype=np.uint32).reshape(3, 4)
    for known in ({"cycles": 1504}, {"cycles": 1504, "before": before}):
        sent = dataclasses.replace(content, **known)
        back = sketch.decode_cdr(sketch.encode_cdr(sent, "spad", layout), sensor)[1]
        assert back.cycles == 1504 and (back.before is None) == ("before" not in known)
    np.testing.assert_array_equal(back.before, before, strict=True)
    assert back.armed_cycles.min() == 1504 - 11


def test_a_description_is_named_by_the_digest_of_its_text():
    text = sensor_message.to_json(SENSOR)
    named = sensor_message.digest(text)
    assert re.fullmatch("[0-9a-f]{8}", named) and sensor_message.digest(SENSOR) == named
    assert sensor_message.digest(sensor_message.from_json(text)) == named
    assert sensor_message.digest(SENSOR.replace(range_offset_m=0.1)) != named
    assert sketch.description_of(CloudMessage.read(CODECS["sketch_int16"].encode_cdr())) == named


def test_fields_in_any_order_and_with_gaps_are_read():
    codec = CODECS["sketch_int16"]
    message, wanted = codec.message(), codec.decode_cdr(codec.encode_cdr())[1]
    old = np.frombuffer(message.data, np.uint8).reshape(12, 12)
    moved = np.zeros((12, 20), np.uint8)
    for field, start, size in ((0, 12, 4), (1, 6, 4), (2, 1, 4)):
        moved[:, start:start + size] = old[:, message.fields[field].offset:][:, :size]
        message.fields[field].offset = start
    message.point_step, message.row_step, message.data = 20, 80, moved.tobytes()
    back = sketch.decode_cdr(serialize_message(message), SENSOR)[1]
    assert (back.photons == wanted.photons).all() and (back.sums == wanted.sums).all()


def rename(old: str, new: str):
    """A change of the first field whose name matches."""
    def change(message: PointCloud2) -> None:
        next(field for field in message.fields if re.fullmatch(old, field.name)).name = new
    return change


def again(name: str):
    return lambda message: message.fields.append(PointField(name=name, offset=0, datatype=2, count=1))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("change", "said"), [
    (rename("T100", "t"), "field T is absent"), (again("T50"), "field T is 100 and 50"),
    (rename("T100", "T128"), "T is 128: expected the sensor's 100 bins"),
    (rename("k3", "k50"), "frequencies is 50"), (rename("k3", "k1"), "frequencies is "),
    (lambda message: (rename("k3", "a")(message), rename("k1", "b")(message)), "sketch size is 0"),
])
def test_names_that_say_nothing_or_fit_no_sensor_are_one_line(layout, change, said):
    message = CODECS[f"sketch_{layout}"].message()
    change(message)
    with pytest.raises(InvalidInput, match=f"^{said}") as caught:
        sketch.decode_cdr(serialize_message(message), SENSOR)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("change", "said"), [
    (rename("sensor_.*", "sensor_12345"), "absent"), (again("sensor_00000000"), "[0-9a-f]{8} and 00000000")])
def test_a_message_that_names_no_description_is_refused(change, said):
    message = CODECS["sketch_float32"].message()
    change(message)
    with pytest.raises(InvalidInput, match=f"^field sensor_DIGEST is {said}"):
        sketch.description_of(CloudMessage.read(serialize_message(message)))
