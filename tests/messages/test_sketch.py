"""`sketch` and `sketch/sensor`: precision, shapes, and what the sensor message must say."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from srt3d_ros.core.sketch import Sketch
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sketch
from srt3d_ros.messages.coded_sketch import DEFAULT_STEP


def random_sketch(seed: int, rows: int, cols: int, m: int) -> Sketch:
    """A sketch of true photons, 0 to 4 in each pixel."""
    rng = np.random.default_rng(seed)
    photons = rng.integers(0, 5, (rows, cols)).astype(np.uint32)
    phases = rng.uniform(0, 2 * np.pi, (rows, cols, m, 4))
    seen = np.arange(4) < photons[..., None, None]
    return Sketch(tuple(range(1, m + 1)), (np.exp(1j * phases) * seen).sum(axis=-1).astype(np.complex64), photons, seed)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32), rows=st.integers(1, 9), cols=st.integers(1, 9), m=st.integers(1, 12),
       layout=st.sampled_from(["float32", "int16", "coded"]))
def test_any_sketch_makes_the_trip(seed, rows, cols, m, layout):
    content = random_sketch(seed, rows, cols, m)
    of_a_mean = {"float32": 1e-6, "int16": 0.5 / 32_767 + 1e-6, "coded": 1e-6}[layout]
    rounding = of_a_mean * content.photons + (layout == "coded") * DEFAULT_STEP / 2**0.5 * np.sqrt(content.photons / 2)
    header, back = sketch.decode_cdr(sketch.encode_cdr(content, "spad", layout), content.frequencies)
    assert (header.stamp_ns, header.frame_id, back.stamp_ns) == (seed, "spad", seed)
    assert back.frequencies == content.frequencies and (back.photons == content.photons).all()
    error = np.abs((back.sums - content.sums).view(np.float32)).reshape(rows, cols, -1)
    assert (error <= rounding[..., None]).all()
    assert (back.sums[content.photons == 0] == 0).all()
    same_header, counts = sketch.decode_counts_cdr(sketch.encode_cdr(content, "spad", layout))
    assert same_header == header and (counts == content.photons).all()


def test_counts_above_two_billion_are_kept():
    content = Sketch((1,), np.full((1, 1, 1), 3e9 + 0j, np.complex64), np.full((1, 1), 3_000_000_000, np.uint32))
    back = sketch.decode_cdr(sketch.encode_cdr(content, "lidar"), (1,))[1]
    assert back.photons[0, 0] == 3_000_000_000 and back.sums[0, 0, 0] == np.complex64(3e9)


def test_without_a_sensor_any_array_is_taken_but_an_empty_one(codecs):
    message = codecs["sketch_float32"].message()
    message.height, message.width, message.row_step = 4, 3, 60
    assert sketch.decode_cdr(serialize_message(message), (1, 3))[1].photons.shape == (4, 3)
    message.height, message.data = 0, b""
    with pytest.raises(InvalidInput, match="^height is 0"):
        sketch.decode_cdr(serialize_message(message), (1, 3))


def test_sensor_frequencies_and_window_make_the_trip(small_sensor):
    sensor, frequencies, window = sketch.decode_sensor(sketch.encode_sensor(small_sensor, (1, 2, 40), 3))
    assert sensor.same_as(small_sensor) and frequencies == (1, 2, 40) and window == 3


@pytest.mark.parametrize(("change", "named"), [
    (lambda content: content.pop("frequencies"), "frequencies"),
    (lambda content: content.update(frequencies=[1, 50]), "frequencies"),
    (lambda content: content.update(frequencies=[1, 2.5]), "frequencies.1"),
    (lambda content: content.update(frequencies=[]), "sketch size"),
    (lambda content: content.update(window_frames=0), "window_frames"),
    (lambda content: content.update(schema_version=2), "schema_version"),
    (lambda content: content.pop("sensor"), "sensor"),
    (lambda content: content["sensor"].pop("rows"), "rows"),
    (lambda content: content.update(window=1), "unknown key"),
])
def test_malformed_sketch_sensor_gives_one_error_that_names_the_field(small_sensor, change, named):
    content = json.loads(sketch.encode_sensor(small_sensor, (1, 2), 1).data)
    change(content)
    with pytest.raises(InvalidInput) as caught:
        sketch.decode_sensor(String(data=json.dumps(content)))
    assert caught.value.field == named and len(str(caught.value).splitlines()) == 1
