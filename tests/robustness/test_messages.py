"""Damaged messages: read, or refused in one line."""

from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.messages import images_message as images
from srt3d_ros.messages import odometry, photon_frames
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages import sensor_message as sensor
from srt3d_ros.messages import sketch_message as sketch
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms
from tests.robustness.conftest import read_or_refused

GOLDEN = Path(__file__).resolve().parents[1] / "messages" / "golden"
SENSOR = SensorModel(rows=3, cols=4, num_bins=100, bin_width_s=1e-10, irf=[1, 2, 1], gates=GateWords(10, 65_535),
                     histograms=HistogramBins(5))
FREQUENCIES = (1, 3)        # of the golden sketches


def golden(*names: str) -> list[bytes]:
    return [bytes.fromhex((GOLDEN / f"{name}.hex").read_text()) for name in names]


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


CODECS = {
    "photons": (frame(photon_frames.PHOTONS), golden("photons_uint16", "photons_float32")),
    "gates": (frame(gates), golden("gates")),
    "histograms": (frame(histograms), golden(*(f"histograms_{kind}5" for kind in ("8UC", "16UC", "32SC", "32FC")))),
    "sketch": (lambda raw: sketch.decode_cdr(raw, SENSOR), golden("sketch_float32", "sketch_int16")),
    "points": (points.decode_cdr, golden("points_xyzi", "points_full")),
    "images": (images.decode_cdr, golden("image_32FC1")),
    "sensor": (lambda raw: sensor.from_json(raw.decode(errors="replace")),
               [(GOLDEN / f"{name}.json").read_bytes() for name in ("sensor", "sensor_lens", "sensor_histograms")]),
    "odometry": (odometry.decode_odometry, [serialize_message(Odometry(child_frame_id="base_link"))]),
    "imu": (odometry.decode_imu, [serialize_message(Imu())]),
}


@pytest.mark.parametrize("topic", CODECS)
def test_a_damaged_message_is_read_or_refused_in_one_line(topic, rounds):
    read_or_refused(*CODECS[topic], rounds)
