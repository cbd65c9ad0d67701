"""`gates` against read-outs of all shapes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from srt3d_ros.core.photons import PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.messages import gates
from srt3d_ros.messages.header import Header


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
    for header, back in (gates.decode_cdr(gates.encode_cdr(content, sensor, "spad"), sensor),
                         gates.decode(gates.encode(content, sensor, "spad"), sensor)):
        assert header == Header(content.stamp_ns, "spad") and back.stamp_ns == content.stamp_ns
        assert back.words.shape == content.words.shape and (back.words == content.words).all()


def test_cycles_are_stacked_vertically(codecs):
    message = codecs["gates"].encode()
    assert (message.height, message.width, message.step, message.encoding) == (6, 4, 8, "16UC1")
    rows = np.frombuffer(message.data, "<u2").reshape(6, 4)
    assert (rows[3:] == codecs["gates"].content.words[1]).all()


def test_words_own_their_memory(codecs):
    _, content = codecs["gates"].decode_cdr(codecs["gates"].encode_cdr())
    flags = content.words.flags
    assert flags.writeable and flags.aligned and flags.c_contiguous and content.words.dtype.isnative
