"""What holds for every binary layout: the bytes, padded rows, broken messages; then images, texts and stamps."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr
from srt3d_ros.messages import images_message as images
from srt3d_ros.messages.cdr import Header
from tests.messages.conftest import same

GOLDEN = Path(__file__).parent / "golden"


def test_bytes_are_the_golden_ones(codec_name, codec):
    golden = bytes.fromhex((GOLDEN / f"{codec_name}.hex").read_text())
    assert codec.encode_cdr().hex() == golden.hex()
    assert same(codec.decode_cdr(golden), codec.decode_cdr(codec.encode_cdr()))


def test_rclpy_reads_and_writes_the_same_bytes(codec):
    raw, serialised = codec.encode_cdr(), serialize_message(codec.message())
    assert len(serialised) == len(raw)
    # rclpy leaves whatever was in memory in the bytes that align numbers: they are set to 0 by reading and writing.
    kind = cdr.CloudMessage if codec.message_class is PointCloud2 else cdr.Image
    assert kind.read(serialised).write() == raw
    assert same(codec.decode_cdr(serialised), codec.decode_cdr(raw))


def test_padded_rows_are_read(codec):
    message = codec.message()
    step = "row_step" if hasattr(message, "row_step") else "step"
    padded = np.pad(np.frombuffer(message.data, np.uint8).reshape(message.height, -1), ((0, 0), (0, 5)))
    setattr(message, step, getattr(message, step) + 5)
    message.data = padded.tobytes()
    assert same(codec.decode(message), codec.decode_cdr(codec.encode_cdr()))


@pytest.mark.parametrize("codec_name", ["photons_uint16", "photons_float32"], indirect=True)
def test_photons_in_an_organised_and_padded_cloud_are_read(codec):
    """A row for each photon, and bytes behind each point and each row."""
    message = codec.message()
    points = np.frombuffer(message.data, np.uint8).reshape(message.width, message.point_step)
    message.height, message.width, message.data = message.width, 1, np.pad(points, ((0, 0), (0, 10))).tobytes()
    message.point_step, message.row_step = message.point_step + 4, message.point_step + 10
    assert same(codec.decode(message), codec.decode_cdr(codec.encode_cdr()))


def test_trailing_bytes_are_allowed_up_to_alignment_and_messages_cut_at_any_byte_refused(codec):
    raw = codec.encode_cdr()
    assert same(codec.decode_cdr(raw + b"\0\0\0"), codec.decode_cdr(raw))
    with pytest.raises(InvalidInput, match="^message is 4 bytes too long"):
        codec.decode_cdr(raw + bytes(4))
    raw = codec.encode_cdr()
    for length in range(len(raw)):
        with pytest.raises(InvalidInput) as caught:
            codec.decode_cdr(raw[:length])
        assert len(str(caught.value).splitlines()) == 1


# ---- Images of one number a pixel, texts and stamps, as rclpy writes and reads them

@settings(max_examples=50, deadline=None)
@given(image=arrays.arrays(np.float32, arrays.array_shapes(min_dims=2, max_dims=2)),
       stamp_ns=st.integers(-2**31 * 10**9, 2**31 * 10**9 - 1),
       frame_id=st.text(st.characters(codec="utf-8", exclude_characters="\0")))
def test_any_image_stamp_and_frame_make_the_trip(image, stamp_ns, frame_id):
    raw = images.encode_cdr(image[:, ::2], stamp_ns, frame_id)
    header, back = images.decode_cdr(raw)
    assert header == Header(stamp_ns, frame_id) and same(back, image[:, ::2]) and back.flags.writeable
    header = deserialize_message(raw, Image).header
    assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp_ns and header.frame_id == frame_id
    stamped = cdr.restamp(raw, 7)
    assert images.decode_cdr(stamped)[0].stamp_ns == 7 and cdr.restamp(stamped, stamp_ns) == raw
    for beyond_ns in (2**31 * 10**9, -2**31 * 10**9 - 1):
        with pytest.raises(InvalidInput, match="^header.stamp is "):
            cdr.restamp(raw, beyond_ns)


@pytest.mark.parametrize(("stamp_ns", "frame_id", "field"), [
    (2**31 * 10**9, "lidar", "header.stamp"), (0, "li\0dar", "header.frame_id"), (0, "\ud800", "header.frame_id")])
def test_header_that_ros_cannot_carry_is_refused(stamp_ns, frame_id, field):
    with pytest.raises(InvalidInput, match=f"^{field} is "):
        Header(stamp_ns, frame_id)


def test_texts_are_written_and_read_as_rclpy_does():
    for text in ("", "a", "{\"irf\": [1, 2]}", "ωₗ"):
        assert deserialize_message(cdr.write_text(text), String).data == text
        assert cdr.read_text(serialize_message(String(data=text))) == text
