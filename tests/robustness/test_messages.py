"""Damaged messages: read, or refused in one line."""

import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.messages import images_message, odometry, photon_frames, points_message, sensor_message, sketch_message
from tests.messages.conftest import CODECS as EXAMPLES
from tests.messages.conftest import FREQUENCIES, SENSOR
from tests.messages.test_codecs import GOLDEN
from tests.robustness.conftest import read_or_refused


def examples(topic: str) -> list[bytes]:
    return [codec.encode_cdr() for name, codec in EXAMPLES.items() if name.startswith(topic)]


def frame(codec):
    """A reader that decodes photons, encodes them again without change, and sketches them."""
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)

    def read(raw: bytes) -> None:
        header, decoded = codec.decode_cdr(raw, SENSOR)
        written = codec.encode_cdr(decoded, SENSOR, header.frame_id)
        header, again = codec.decode_cdr(written, SENSOR)
        assert codec.encode_cdr(again, SENSOR, header.frame_id) == written
        sketcher.reset()
        decoded.check(SENSOR)
        sketcher.add(decoded)

    return read


CODECS = {topic: (frame(codec), examples(topic)) for topic, codec in photon_frames.CODECS.items()} | {
    "sketch": (lambda raw: sketch_message.decode_cdr(raw, SENSOR), examples("sketch")),
    "points": (points_message.decode_cdr, examples("points")), "images": (images_message.decode_cdr, examples("image")),
    "sensor": (lambda raw: sensor_message.from_json(raw.decode(errors="replace")),
               [(GOLDEN / f"{name}.json").read_bytes() for name in ("sensor", "sensor_lens", "sensor_histograms")]),
    "odometry": (odometry.decode_odometry, [serialize_message(Odometry(child_frame_id="base_link"))]),
    "imu": (odometry.decode_imu, [serialize_message(Imu())])}


@pytest.mark.parametrize("topic", CODECS)
def test_a_damaged_message_is_read_or_refused_in_one_line(topic, rounds):
    read_or_refused(*CODECS[topic], rounds)
