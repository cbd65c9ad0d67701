"""`histograms` against frames of all types and shapes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from srt3d_ros.core.histogram_bins import HistogramBins
from srt3d_ros.core.photons import COUNT_DTYPES, MAX_OF_PIXEL, PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, histograms
from srt3d_ros.messages.cdr import Header


@st.composite
def frames(draw):
    sensor = SensorModel(rows=draw(st.integers(1, 5)), cols=draw(st.integers(1, 5)), num_bins=draw(st.integers(2, 40)),
                         bin_width_s=1e-10, irf=np.ones(1))
    if draw(st.booleans()):
        sensor = sensor.replace(histograms=HistogramBins(draw(st.integers(1, sensor.num_bins))))
    bins = sensor.num_bins if sensor.histograms is None else sensor.histograms.num_bins
    dtype = draw(st.sampled_from(COUNT_DTYPES))
    most = MAX_OF_PIXEL // 64
    within = {} if np.dtype(dtype).kind == "u" else {"min_value": -most, "max_value": most}
    counts = draw(arrays.arrays(dtype, (sensor.rows, sensor.cols, bins),
                                elements=arrays.from_dtype(np.dtype(dtype), **within)))
    return sensor, PhotonHistograms(counts, draw(st.integers(0, 2**60)))


@settings(max_examples=100, deadline=None)
@given(frames())
def test_any_counts_make_the_trip(case):
    sensor, content = case
    header, back = histograms.decode_cdr(histograms.encode_cdr(content, sensor, "spad"), sensor)
    assert header == Header(content.stamp_ns, "spad") and back.stamp_ns == content.stamp_ns
    assert back.counts.dtype == content.counts.dtype and back.counts.tobytes() == content.counts.tobytes()


@pytest.mark.parametrize("name, size", [("8UC5", 1), ("16UC5", 2), ("32SC5", 4), ("32FC5", 4)])
def test_the_bins_of_a_pixel_are_the_channels_of_an_image(codecs, name, size):
    message = codecs[f"histograms_{name}"].message()
    assert (message.height, message.width, message.step, message.encoding) == (3, 4, 4 * 5 * size, name)
    counts = codecs[f"histograms_{name}"].content.counts
    at = 2 * message.step + (1 * 5 + 3) * size          # as the byte table says: row 2, column 1, bin 3
    assert bytes(message.data[at:at + size]) == counts[2, 1, 3].tobytes()


@pytest.mark.parametrize("name, order", [("8UC5", "|"), ("16UC5", ">"), ("32SC5", ">"), ("32FC5", ">")])
def test_counts_are_copied_only_where_their_bytes_lie_otherwise(codecs, name, order):
    codec = codecs[f"histograms_{name}"]
    image, counts = cdr.read_image(codec.encode_cdr()), codec.content.counts
    rows = counts.reshape(3, -1)
    padded = np.pad(rows, ((0, 0), (0, 3)))
    for lies, copied in ((rows, False), (rows.astype(rows.dtype.newbyteorder(order)), order == ">"), (padded, True)):
        raw = cdr.write_image(replace(image, is_bigendian=lies.dtype.byteorder == ">", step=lies.strides[0],
                                      data=memoryview(lies.tobytes())))
        read = codec.decode_cdr(raw)[1].counts
        assert (read == counts).all() and read.flags.aligned and read.flags.c_contiguous and read.dtype.isnative
        assert np.shares_memory(read, np.frombuffer(raw, np.uint8)) is not copied


def test_a_frame_that_does_not_fit_the_description_says_what_would(codecs, small_sensor):
    raw = codecs["histograms_16UC5"].encode_cdr()
    with pytest.raises(InvalidInput, match="^encoding is 16UC5: expected 8UC100 or 16UC100 or 32SC100 or 32FC100$"):
        histograms.decode_cdr(raw, small_sensor.replace(histograms=None))
    with pytest.raises(InvalidInput, match="^height is 3: expected the sensor's 6 rows$"):
        histograms.decode_cdr(raw, small_sensor.replace(rows=6))
