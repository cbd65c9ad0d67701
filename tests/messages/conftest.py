"""One small example of every binary layout, with the functions that carry it."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.messages import images_message as images
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages import sketch_message as sketch
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms

STAMP_NS = 1_700_000_000_250_000_000
SENSOR = SensorModel(rows=3, cols=4, num_bins=100, bin_width_s=1e-10, irf=np.array([1, 2, 1]),
                     gates=GateWords(first_word=10, no_detection=65_535), histograms=HistogramBins(5))
FREQUENCIES = (1, 3)


@dataclass(frozen=True)
class Codec:
    """A layout of a topic: how its example is written and read."""

    message_class: type
    content: object
    encode_cdr: Callable[[], bytes]
    decode_cdr: Callable[[bytes], tuple]

    def message(self):
        """The example as rclpy hands it to a subscription."""
        return deserialize_message(self.encode_cdr(), self.message_class)

    def decode(self, message) -> tuple:
        """What a message says."""
        return self.decode_cdr(serialize_message(message))


def _codec(module, message_class, content, writing: tuple, reading: tuple) -> Codec:
    return Codec(message_class, content, partial(module.encode_cdr, content, *writing),
                 lambda raw: module.decode_cdr(raw, *reading))


def same(a, b) -> bool:
    """True if two decoded contents are equal to the bit, types included."""
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return a == b


WORDS = np.arange(10, 34, dtype=np.uint16).reshape(2, 3, 4)
WORDS[0, 1] = 65_535
SKETCH = PhaseSums(FREQUENCIES, np.array([1, 1j, -1, 0.5 - 0.5j] * 6, np.complex64).reshape(3, 4, 2) * np.float32(2),
                np.full((3, 4), 2, np.uint32), STAMP_NS, sensor=SENSOR)
SKETCH.photons[0, 0], SKETCH.sums[0, 0] = 0, 0
CLOUD = PointCloud(row=np.array([0, 2], np.uint16), col=np.array([1, 3], np.uint16),
              depth_bins=np.array([10, 20.5], np.float32), intensity=np.array([3, 0.25], np.float32),
              depth_std_bins=np.array([1, 2], np.float32), xyz=np.array([[1, 2, 3], [-4, 5, 6]], np.float32),
              surface=np.array([0, 1], np.uint8), background=np.arange(12, dtype=np.float32).reshape(3, 4),
              stamp_ns=STAMP_NS, sensor=SENSOR)
FREE = np.full((3, 4), np.nan, np.float32)
FREE[0, 1], FREE[2, 3] = 2, 6.5
IMAGE = np.array([[1, np.nan], [0.5, -2], [3, 4]], np.float32)


def _photons(toa: list, dtype) -> Codec:
    events = PhotonEvents(np.array([11, 0, 6], np.uint32), np.array(toa, dtype), STAMP_NS)
    return _codec(photon_frames.PHOTONS, PointCloud2, events, (SENSOR, "lidar"), (SENSOR,))


def _histograms(dtype, least: int) -> Codec:
    counts = np.arange(least, least + 60).astype(dtype).reshape(3, 4, 5)
    return _codec(histograms, Image, PhotonHistograms(counts, STAMP_NS), (SENSOR, "lidar"), (SENSOR,))


CODECS = {
    "photons_uint16": _photons([99, 0, 7], np.uint16),
    "photons_float32": _photons([99.5, 0, 7.25], np.float32),
    "gates": _codec(gates, Image, PhotonGates(WORDS, STAMP_NS), (SENSOR, "lidar"), (SENSOR,)),
    "histograms_8UC5": _histograms(np.uint8, 190),
    "histograms_16UC5": _histograms(np.uint16, 990),
    "histograms_32SC5": _histograms(np.int32, -10),
    "histograms_32FC5": _histograms(np.float32, -10),
    "sketch_float32": _codec(sketch, PointCloud2, SKETCH, ("lidar",), (SENSOR,)),
    "sketch_int16": _codec(sketch, PointCloud2, SKETCH, ("lidar", "int16"), (SENSOR,)),
    "points_xyzi": _codec(points, PointCloud2, CLOUD, ("lidar",), ()),
    "points_full": _codec(points, PointCloud2, CLOUD, ("lidar", "full"), ()),
    "free_xyz": Codec(PointCloud2, FREE, partial(points.encode_ends_cdr, FREE, SENSOR, STAMP_NS, "lidar"),
                      points.decode_ends_cdr),
    "image_32FC1": _codec(images, Image, IMAGE, (STAMP_NS, "lidar"), ()),
}


@pytest.fixture(scope="session", params=CODECS)
def codec_name(request) -> str:
    """Each layout in turn."""
    return request.param


@pytest.fixture(scope="session")
def codec(codec_name) -> Codec:
    """The functions and the example of the layout."""
    return CODECS[codec_name]
