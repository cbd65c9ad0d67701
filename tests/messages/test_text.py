"""Serialised texts and stamps, held against what rclpy writes and reads."""

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import String

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr

STAMP_NS = 1_700_000_000_250_000_001
BIG_ENDIAN = b"\0\0\0\0" + (5).to_bytes(4, "big") + (6).to_bytes(4, "big") + b"the rest"


@pytest.mark.parametrize("text", ["", "a", "{\"irf\": [1, 2]}", "ωₗ"])
def test_texts_are_written_and_read_as_rclpy_does(text):
    assert deserialize_message(cdr.write_text(text), String).data == text
    assert cdr.read_text(serialize_message(String(data=text))) == text


@pytest.mark.parametrize("raw", [b"", b"\0\1\0\0\x08\0\0\0abc\0", b"\0\1\0\0\2\0\0\0\xff\0", b"\0\1\0\0\2\0\0\0ab"])
def test_what_is_no_text_is_refused(raw):
    with pytest.raises(InvalidInput):
        cdr.read_text(raw)


def test_a_stamp_is_read_and_replaced_and_nothing_else():
    raw = serialize_message(Image(width=3, encoding="16UC1"))
    stamped = cdr.restamp(raw, STAMP_NS)
    header = deserialize_message(stamped, Image).header
    assert (header.stamp.sec, header.stamp.nanosec) == (1_700_000_000, 250_000_001)
    assert cdr.stamp_ns(stamped) == STAMP_NS and cdr.restamp(stamped, 0) == raw


def test_stamps_are_in_the_byte_order_of_their_message():
    assert cdr.stamp_ns(BIG_ENDIAN) == 5_000_000_006
    stamped = cdr.restamp(BIG_ENDIAN, STAMP_NS)
    assert cdr.stamp_ns(stamped) == STAMP_NS and stamped.endswith(b"the rest")
    with pytest.raises(InvalidInput, match="header.stamp"):
        cdr.stamp_ns(BIG_ENDIAN[:9])
