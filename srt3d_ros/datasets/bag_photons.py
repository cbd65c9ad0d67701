"""The photons or sketches in a bag: which of its topics they are on, and single frames of them."""

import re
from dataclasses import dataclass
from pathlib import Path

from srt3d_ros.core.photons import PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.datasets.bag import Bag, BagTopic
from srt3d_ros.datasets.photons import ASSUMED_FOV, Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr, json_text
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.photon_frames import CODECS

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
PHOTON_FIELDS = {"row", "col", "toa"}
SKETCH_FIELDS = ({"photons", "sketch"}, {"coded"})
GATES_ENCODING = "16UC1"
HISTOGRAMS_ENCODING = re.compile(r"(?:8U|16U|32S|32F)C(\d{1,5})")
MOST_CAMERA_CHANNELS = 4        # of the images of cameras, whose encodings look alike


@dataclass(frozen=True)
class PhotonTopics:
    """Where the photons of a bag are, or its sketches, and their description, if there is one."""

    output: str         # what the messages on `frames` are: a key of CODECS, or "sketch"
    frames: BagTopic
    sensor: BagTopic | None


def find_photons(bag: Bag, photons_topic: str = "", sensor_topic: str = "") -> PhotonTopics:
    """The topics of the photons and of their sensor, whatever they were remapped to; of sketches if it has no photons.

    The photons are on the topic whose messages are photons; of several, on the one that is called as what it holds,
    `photons`, `gates` or `histograms`, in whatever namespace. The sensor is described on the topic that does so; of
    several, on `sensor` in the namespace of the photons. In the same way for `sketch` and `sketch/sensor`.

    Args:
        photons_topic, sensor_topic: their names, where a bag has several that could be meant.

    Raises:
        InvalidInput: there are none (of photons) or several; the line lists what is in the bag.
    """
    contents = {topic: _content(bag, topic) for topic in bag.topics if topic.messages > 0}
    frames = [topic for topic, content in contents.items()
              if content in (*CODECS, "sketch") and photons_topic in ("", topic.name)]
    frames = [topic for topic in frames if contents[topic] != "sketch"] or frames
    named = [topic for topic in frames if topic.name.rsplit("/", 1)[-1] == contents[topic]]
    photons = _the_only(named or frames, "photons_topic", photons_topic, bag)
    is_sketch = contents[photons] == "sketch"
    sensors = [topic for topic, content in contents.items()
               if content == ("sketch/sensor" if is_sketch else "sensor") and sensor_topic in ("", topic.name)]
    place = photons.name if is_sketch else photons.name.rsplit("/", 1)[0]
    beside = [topic for topic in sensors if topic.name == f"{place}/sensor"]
    sensor = None
    if sensors or sensor_topic:
        sensor = _the_only(beside or sensors, "sensor_topic", sensor_topic, bag)
    return PhotonTopics(contents[photons], photons, sensor)


def read_frame(path: str | Path, number: int = 0, photons_topic: str = "") -> Photons:
    """One frame of a bag: message `number` of its photons, with the sensor that was in force when it came.

    Raises:
        InvalidInput: the bag cannot be read, has no photons, no sensor or fewer frames.
    """
    with Bag(path) as bag:
        topics = find_photons(bag, photons_topic)
        require(topics.output != "sketch", "bag", str(path), "one of photons; it has sketches of them")
        described, raw = _read(bag, topics, number)
    sensor = sensor_message.decode_cdr(described)
    frame = CODECS[topics.output].decode_cdr(raw, sensor)[1]
    notes = () if "projection" in json_text.parse(cdr.read_text(described), "sensor") else (ASSUMED_FOV,)
    return Photons(sensor, frame.to_events(sensor) if isinstance(frame, PhotonGates) else frame, None,
                   f"{Path(path).stem}_{number}", notes)


def read_sketch(path: str | Path, number: int = 0, sketch_topic: str = "") -> tuple[SensorModel, Sketch] | None:
    """One frame of a bag of sketches, with its sensor; None if the bag has photons. InvalidInput as `read_frame`."""
    with Bag(path) as bag:
        topics = find_photons(bag, sketch_topic)
        if topics.output != "sketch":
            return None
        described, raw = _read(bag, topics, number)
    sensor, frequencies, _ = sketch_message.decode_sensor_cdr(described)
    return sensor, sketch_message.decode_cdr(raw, frequencies, sensor)[1]


def _read(bag: Bag, topics: PhotonTopics, number: int) -> tuple[bytes, bytes]:
    """The serialised description and the serialised frame; InvalidInput if there is none."""
    require(topics.sensor is not None, f"bag {bag.path.name}", "without a sensor",
            f"a description of the sensor beside {topics.frames.name}; it has {bag.content()}")
    last = topics.frames.messages - 1
    require(0 <= number <= last, "frame", number, f"0 to {last}, the messages on {topics.frames.name}")
    return _frame_with_sensor(bag, topics, number)


def _frame_with_sensor(bag: Bag, topics: PhotonTopics, number: int) -> tuple[bytes, bytes]:
    """The serialised description of the sensor and the serialised frame."""
    described = frame = None
    for message in bag.messages((topics.frames, topics.sensor)):
        if message.topic == topics.sensor.name:
            described = message.raw
        elif frame is None:
            frame = message.raw if number == 0 else None
            number -= 1
        if described is not None and frame is not None:     # a sensor that came late still describes the first frames
            return described, frame
    raise InvalidInput(f"bag {bag.path.name}", "shorter than it says", "a complete bag")


def _content(bag: Bag, topic: BagTopic) -> str:
    """What the first message of a topic holds: a key of CODECS, "sketch", "sensor", "sketch/sensor", or else ""."""
    if topic.type not in (CLOUD, IMAGE, TEXT):
        return ""
    raw = next((message.raw for message in bag.messages((topic,))), b"")    # a bag may lie about its messages
    readers = {CLOUD: (_cloud_content,), IMAGE: (_image_content,), TEXT: (_describes_sensor, _describes_sketch)}
    for read in readers[topic.type]:
        try:
            return read(raw)
        except InvalidInput:
            pass
    return ""


def _cloud_content(raw: bytes) -> str:
    names = {field.name for field in cdr.read_cloud(raw).fields}
    return "photons" if PHOTON_FIELDS <= names else "sketch" if any(own <= names for own in SKETCH_FIELDS) else ""


def _image_content(raw: bytes) -> str:
    encoding = cdr.read_image(raw).encoding
    bins = HISTOGRAMS_ENCODING.fullmatch(encoding)
    return ("gates" if encoding == GATES_ENCODING else
            "histograms" if bins and int(bins[1]) > MOST_CAMERA_CHANNELS else "")


def _describes_sensor(raw: bytes) -> str:
    sensor_message.decode_cdr(raw)
    return "sensor"


def _describes_sketch(raw: bytes) -> str:
    sketch_message.decode_sensor_cdr(raw)
    return "sketch/sensor"


def _the_only(candidates: list[BagTopic], field: str, given: str, bag: Bag) -> BagTopic:
    require(len(candidates) == 1, field, given or "not given",
            f"the name of one topic of {field.removesuffix('_topic')}; {bag.path.name} has {bag.content()}")
    return candidates[0]
