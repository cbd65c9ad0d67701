"""`photons`, `gates` and `histograms`: frames of all kinds, and messages as other drivers write them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, photon_frames
from srt3d_ros.messages.cdr import Header
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms
from tests.messages.conftest import same


@st.composite
def events(draw):
    sensor = SensorModel(rows=draw(st.integers(1, 65_536)), cols=draw(st.integers(1, 64)),
                         num_bins=draw(st.integers(2, 65_535)), bin_width_s=1e-10, irf=np.ones(1))
    count = draw(st.integers(0, 50))
    pixel = draw(arrays.arrays(np.uint32, count, elements=st.integers(0, sensor.pixels - 1)))
    dtype = draw(st.sampled_from([np.uint16, np.float32]))
    bins = st.floats(0, sensor.num_bins, width=32, exclude_max=True) if dtype is np.float32 else \
        st.integers(0, sensor.num_bins - 1)
    toa = draw(arrays.arrays(dtype, count, elements=bins))
    return sensor, PhotonEvents(pixel, toa, draw(st.integers(0, 2**60)))


@settings(max_examples=100, deadline=None)
@given(events())
def test_any_photons_make_the_trip(case):
    sensor, content = case
    header, back = photon_frames.PHOTONS.decode_cdr(photon_frames.PHOTONS.encode_cdr(content, sensor, "spad"), sensor)
    assert header == Header(content.stamp_ns, "spad") and same(back, content)


@pytest.mark.parametrize("name, order", [("gates", ">"), ("histograms_8UC5", "|"), ("histograms_16UC5", ">"),
                                         ("histograms_32FC5", ">")])
def test_images_are_copied_only_where_their_bytes_lie_otherwise(codecs, name, order):
    image, whole = cdr.read_image(codecs[name].encode_cdr()), vars(codecs[name].content)
    numbers = whole.get("words", whole.get("counts"))
    rows = numbers.reshape(image.height, -1)
    padded = np.pad(rows, ((0, 0), (0, 3)))
    for lies, copied in ((rows, False), (rows.astype(rows.dtype.newbyteorder(order)), order == ">"), (padded, True)):
        raw = cdr.write_image(replace(image, is_bigendian=lies.dtype.byteorder == ">", step=lies.strides[0],
                                      data=memoryview(lies.tobytes())))
        found = vars(codecs[name].decode_cdr(raw)[1])
        read = found.get("words", found.get("counts"))
        assert (read == numbers).all() and read.flags.aligned and read.flags.c_contiguous and read.dtype.isnative
        assert np.shares_memory(read, np.frombuffer(raw, np.uint8)) is not copied


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("count", [3, 0])
def test_other_order_padding_and_further_fields_are_read(small_sensor, order, count):
    kinds = {"toa": ("f4", PointField.FLOAT32), "tdc": ("u1", PointField.UINT8), "_": ("u1", PointField.UINT8),
             "t": ("u4", PointField.UINT32), "col": ("u2", PointField.UINT16), "row": ("u2", PointField.UINT16)}
    offsets = dict(zip(kinds, (1, 5, 6, 8, 13, 18)))
    points = np.full(3 * 23, 0xAB, np.uint8).view(np.dtype({
        "names": list(kinds), "offsets": list(offsets.values()), "itemsize": 23,
        "formats": [order + kind for kind, _ in kinds.values()]}))
    points["row"], points["col"], points["toa"] = [2, 0, 1], [3, 0, 2], [99.5, 0, 7.25]
    fields = [PointField(name=name, offset=offsets[name], datatype=code, count=1) for name, (_, code) in kinds.items()]
    fields.append(PointField(name="_", offset=7, datatype=PointField.UINT8, count=1))       # a second of this name
    message = PointCloud2(height=1, width=count, fields=fields, is_bigendian=order == ">", point_step=23,
                          row_step=23 * count, data=points[:count].tobytes())
    _, found = photon_frames.PHOTONS.decode_cdr(serialize_message(message), small_sensor)
    assert found.pixel.tolist() == [11, 0, 6][:count] and found.toa.tolist() == [99.5, 0, 7.25][:count]
    assert found.toa.dtype == np.float32


def test_a_frame_that_does_not_fit_the_description_says_what_would(codecs, small_sensor):
    raw = codecs["histograms_16UC5"].encode_cdr()
    with pytest.raises(InvalidInput, match="^encoding is 16UC5: expected 8UC100 or 16UC100 or 32SC100 or 32FC100$"):
        histograms.decode_cdr(raw, small_sensor.replace(histograms=None))
    with pytest.raises(InvalidInput, match="^height is 3: expected the sensor's 6 rows$"):
        histograms.decode_cdr(raw, small_sensor.replace(rows=6))
    with pytest.raises(InvalidInput, match="^sensor.gates is missing"):
        gates.decode_cdr(codecs["gates"].encode_cdr(), small_sensor.replace(gates=None))
