"""`gates` against read-outs of all shapes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from srt3d_ros.core.photons import CHUNK, PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, gates
from srt3d_ros.messages.cdr import Header


@st.composite
def sensors_with_gates(draw):
    first, bins = draw(st.integers(0, 1000)), draw(st.integers(2, 1000))
    sensor = SensorModel(rows=draw(st.integers(1, 9)), cols=draw(st.integers(1, 9)), num_bins=bins, bin_width_s=1e-10,
                         irf=np.ones(1), gates=GateWords(first, draw(st.integers(0, 65_535))))
    word = st.integers(first, first + bins - 1) | st.just(sensor.gates.no_detection)
    shape = (draw(st.integers(0, 6)), sensor.rows, sensor.cols)
    return sensor, PhotonGates(draw(arrays.arrays(np.uint16, shape, elements=word)), draw(st.integers(0, 2**60)))


@settings(max_examples=100, deadline=None)
@given(sensors_with_gates())
def test_any_words_make_the_trip(case):
    sensor, content = case
    header, back = gates.decode_cdr(gates.encode_cdr(content, sensor, "spad"), sensor)
    assert header == Header(content.stamp_ns, "spad") and back.stamp_ns == content.stamp_ns
    assert back.words.shape == content.words.shape and (back.words == content.words).all()
    assert back.photons == np.count_nonzero(content.words != sensor.gates.no_detection)


def test_cycles_are_stacked_vertically(codecs):
    message = codecs["gates"].message()
    assert (message.height, message.width, message.step, message.encoding) == (6, 4, 8, "16UC1")
    rows = np.frombuffer(message.data, "<u2").reshape(6, 4)
    assert (rows[3:] == codecs["gates"].content.words[1]).all()


def test_words_lie_as_compiled_code_wants_them_and_are_copied_only_where_they_do_not(codecs):
    image = cdr.read_image(codecs["gates"].encode_cdr())
    rows = np.frombuffer(image.data, "<u2").reshape(6, 4)
    padded = np.pad(rows, ((0, 0), (0, 3)))
    for shape, copied in ((rows, False), (rows.astype(">u2"), True), (padded, True)):
        raw = cdr.write_image(replace(image, is_bigendian=shape.dtype.byteorder == ">", step=shape.strides[0],
                                      data=memoryview(shape.tobytes())))
        words = codecs["gates"].decode_cdr(raw)[1].words
        assert (words.reshape(6, 4) == rows).all()
        assert words.flags.aligned and words.flags.c_contiguous and words.dtype.isnative
        assert np.shares_memory(words, np.frombuffer(raw, np.uint8)) is not copied


def test_a_wrong_word_is_found_wherever_it_is():
    sensor = SensorModel(rows=2, cols=3, num_bins=50, bin_width_s=1e-10, irf=np.ones(1), gates=GateWords(10, 0))
    for at in (0, CHUNK - 1, CHUNK, 2 * CHUNK - 3):
        words = np.zeros((CHUNK // 3, 2, 3), np.uint16)
        raw = bytearray(gates.encode_cdr(PhotonGates(words), sensor, "spad"))
        start = len(raw) - 2 * words.size
        raw[start + 2 * at:start + 2 * at + 2] = (60).to_bytes(2, "little")
        with pytest.raises(InvalidInput, match="gates word is 60: expected 10 to 59, or 0"):
            gates.decode_cdr(bytes(raw), sensor)
