"""`photons` against events of all kinds and messages as other drivers write them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.photons import MAX_T_NS, PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.messages import cdr, photons
from srt3d_ros.messages.cdr import Header


@st.composite
def sensors_with_events(draw):
    sensor = SensorModel(rows=draw(st.integers(1, 300)), cols=draw(st.integers(1, 300)),
                         num_bins=draw(st.integers(2, 65_535)), bin_width_s=1e-10, irf=np.ones(1))
    count = draw(st.integers(0, 50))
    pixel = draw(arrays.arrays(np.uint32, count, elements=st.integers(0, sensor.pixels - 1)))
    dtype = draw(st.sampled_from([np.uint16, np.uint32, np.float32]))
    bins = st.floats(0, sensor.num_bins, width=32, exclude_max=True) if dtype is np.float32 else \
        st.integers(0, sensor.num_bins - 1)
    t = draw(st.none() | arrays.arrays(np.uint32, count, elements=st.integers(0, MAX_T_NS)))
    return sensor, PhotonEvents(pixel, draw(arrays.arrays(dtype, count, elements=bins)), draw(st.integers(0, 2**60)), t)


@settings(max_examples=100, deadline=None)
@given(sensors_with_events())
def test_any_events_make_the_trip_in_their_order(case):
    sensor, events = case
    header, back = photons.decode_cdr(photons.encode_cdr(events, sensor, "spad"), sensor)
    assert header == Header(events.stamp_ns, "spad") and back.stamp_ns == events.stamp_ns
    assert back.pixel.tobytes() == events.pixel.tobytes()
    assert back.toa.dtype == events.toa.dtype and back.toa.tobytes() == events.toa.tobytes()
    assert (back.t is None) == (events.t is None) and (back.t is None or back.t.tobytes() == events.t.tobytes())
    for array in (back.pixel, back.toa) if back.t is None else (back.pixel, back.toa, back.t):
        assert array.flags.writeable and array.flags.aligned and array.flags.c_contiguous and array.dtype.isnative


def test_no_photons_is_a_valid_frame(small_sensor):
    nothing = PhotonEvents(np.zeros(0, np.uint32), np.zeros(0, np.uint16), 5)
    raw = photons.encode_cdr(nothing, small_sensor, "lidar")
    message = cdr.read_cloud(raw)
    assert (message.height, message.width, message.row_step, len(message.data)) == (1, 0, 0, 0)
    assert photons.decode_cdr(raw, small_sensor)[1].photons == 0


@pytest.mark.parametrize("big_endian", [False, True])
def test_other_order_padding_and_further_fields_are_read(small_sensor, big_endian):
    order = ">" if big_endian else "<"
    point = np.dtype({"names": ["toa", "tdc", "_", "col", "row"], "offsets": [1, 5, 6, 9, 14], "itemsize": 19,
                      "formats": [order + "f4", "u1", "u1", order + "u2", order + "u2"]})
    data = np.full(3 * 19, 0xAB, np.uint8)
    points = data.view(point)
    points["row"], points["col"], points["toa"] = [2, 0, 1], [3, 0, 2], [99.5, 0, 7.25]
    codes = {"toa": PointField.FLOAT32, "tdc": PointField.UINT8, "_": PointField.UINT8,
             "col": PointField.UINT16, "row": PointField.UINT16}
    fields = [PointField(name=name, offset=point.fields[name][1], datatype=code, count=1)
              for name, code in codes.items()]
    fields.append(PointField(name="_", offset=7, datatype=PointField.UINT8, count=1))
    message = PointCloud2(height=1, width=3, fields=fields, is_bigendian=big_endian, point_step=19, row_step=57,
                          data=data.tobytes())
    _, events = photons.decode_cdr(serialize_message(message), small_sensor)
    assert events.pixel.tolist() == [11, 0, 6] and events.toa.tolist() == [99.5, 0, 7.25]
    assert events.toa.dtype == np.float32 and events.toa.dtype.isnative


def test_t_in_another_place_and_order_is_read_and_a_frame_without_photons_keeps_it(small_sensor):
    point = np.dtype({"names": ["t", "toa", "col", "row"], "offsets": [1, 6, 9, 14], "itemsize": 17,
                      "formats": [">u4", ">u2", ">u2", ">u2"]})
    points = np.zeros(2, point)
    points["t"], points["toa"] = [0, 33_000_000], [5, 99]
    codes = {"t": PointField.UINT32, "toa": PointField.UINT16, "col": PointField.UINT16, "row": PointField.UINT16}
    fields = [PointField(name=name, offset=point.fields[name][1], datatype=code, count=1)
              for name, code in codes.items()]
    for count in (2, 0):
        message = PointCloud2(height=1, width=count, fields=fields, is_bigendian=True, point_step=17,
                              row_step=17 * count, data=points[:count].tobytes())
        _, events = photons.decode_cdr(serialize_message(message), small_sensor)
        assert events.t.tolist() == [0, 33_000_000][:count] and events.t.dtype == np.uint32 and events.t.dtype.isnative


def test_last_row_and_column_of_the_largest_side_fit():
    sensor = SensorModel(rows=65_536, cols=1, num_bins=65_535, bin_width_s=1e-10, irf=np.ones(1))
    events = PhotonEvents(np.array([65_535], np.uint32), np.array([65_534], np.uint16))
    assert photons.decode_cdr(photons.encode_cdr(events, sensor, ""), sensor)[1].pixel.tolist() == [65_535]


def test_a_message_announces_its_photons_unless_its_bytes_cannot_hold_them(codecs):
    raw = codecs["photons_uint16"].encode_cdr()
    assert photons.announced(raw) == 3
    for broken in (b"", raw[:30], raw[:28] + b"\xff\xff\xff\xff" + raw[32:]):      # the width
        assert photons.announced(broken) == 0
