"""The photons or sketches in a bag: which of its topics they are on, and single frames of them."""

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from srt3d_ros.core.sketching.photon_frame import PhotonGates
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.datasets.bags.bag import Bag, BagTopic
from srt3d_ros.datasets.options import ASSUMED_FOV, sketch_with_options
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr, sensor_message, sketch_message
from srt3d_ros.messages.photon_frames import CODECS

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
PHOTON_FIELDS = {"row", "col", "toa"}
GATES_ENCODING = "16UC1"
HISTOGRAMS_ENCODING = re.compile(r"(?:8U|16U|32S|32F)C(\d{1,5})")
MOST_CAMERA_CHANNELS = 4        # of the images of cameras, whose encodings look alike


@dataclass(frozen=True)
class PhotonTopics:
    """Where the photons of a bag are, or its sketches, and their description, if there is one."""

    output: str         # what the messages on `frames` are: a key of CODECS, or "sketch"
    frames: BagTopic
    sensor: BagTopic | None


def find_photons(bag: Bag, photons_topic: str = "") -> PhotonTopics:
    """The topics of the photons and of their sensor, whatever they were remapped to; of sketches if it has no photons.

    The photons are on the topic whose messages are photons; of several, on the one that is called as what it holds,
    `photons`, `gates` or `histograms`, in whatever namespace. The sensor is described on the topic that does so; of
    several, on `sensor` in the namespace of the photons. In the same way for `sketch` and `sketch/sensor`.

    Args:
        photons_topic: its name, where a bag has several that could be meant.

    Raises:
        InvalidInput: there are none (of photons) or several; the line lists what is in the bag.
    """
    contents = {topic: _content(bag, topic) for topic in bag.topics if topic.messages > 0}
    frames = [topic for topic, content in contents.items()
              if content in (*CODECS, "sketch") and photons_topic in ("", topic.name)]
    frames = [topic for topic in frames if contents[topic] != "sketch"] or frames
    named = [topic for topic in frames if topic.name.rsplit("/", 1)[-1] == contents[topic]]
    require(frames or not photons_topic, "photons_topic", photons_topic,
            f"a topic of photons or sketches; {bag.path.name} has {bag.content()}")
    photons = _the_only(named or frames, "photons", bag)
    is_sketch = contents[photons] == "sketch"
    described = [topic for topic, content in contents.items() if content == "sensor"]
    behind_gate = [topic for topic in described if topic.name.endswith("sketch/sensor")]
    sensors = behind_gate or described if is_sketch else [topic for topic in described if topic not in behind_gate]
    place = photons.name if is_sketch else photons.name.rsplit("/", 1)[0]
    beside = [topic for topic in sensors if topic.name == f"{place}/sensor"]
    sensor = _the_only(beside or sensors, "sensor", bag) if sensors else None
    return PhotonTopics(contents[photons], photons, sensor)


def read_frame(path: str | Path, number: int, options: dict, photons_topic: str = "") -> Photons | Sketch:
    """Photons or sketch of a message of a bag.

    The sensor of photons is the last that was described before them, or at first the first; that of a sketch is the
    one that it names.

    Args:
        options: options.gathered, in place of what the bag says.
        photons_topic: as of `find_photons`.

    Raises:
        InvalidInput: the bag cannot be read, or has no such frame or no sensor; an option that cannot be used.
    """
    with Bag(path) as bag:
        topics = find_photons(bag, photons_topic)
        require(topics.sensor is not None, f"bag {bag.path.name}", "without a sensor",
                f"a description of the sensor beside {topics.frames.name}; it has {bag.content()}")
        most = topics.frames.messages - 1
        require(0 <= number <= most, "frame", number, f"0 to {most}, the messages on {topics.frames.name}")
        raw, description = _frame(bag, topics, number)
        if topics.output == "sketch":
            description = _named(bag, topics.sensor, sketch_message.description_of(cdr.read_cloud(raw)), number)
    sensor = sensor_message.decode_cdr(description)
    if topics.output == "sketch":
        found = sketch_message.decode_cdr(raw, sensor)[1]
        return sketch_with_options(found, options)
    photons = CODECS[topics.output].decode_cdr(raw, sensor)[1]
    if isinstance(photons, PhotonGates):
        sensor, photons = photons.counted(sensor), photons.to_events(sensor)
    notes = () if "projection" in json_text.parse(cdr.read_text(description), "sensor") else (ASSUMED_FOV,)
    return Photons(sensor, photons, None, f"{bag.path.stem}_{number}", notes).with_options(options)


def _frame(bag: Bag, topics: PhotonTopics, number: int) -> tuple[bytes, bytes]:
    """Message `number` on the topic of the frames, and the description before it; InvalidInput if it is not there."""
    described = next((raw for _, raw in bag.messages((topics.sensor,))), None)
    for topic, raw in bag.messages((topics.frames, topics.sensor)) if described else ():
        if topic == topics.sensor.name:
            described = raw
        elif number == 0:
            return raw, described
        else:
            number -= 1
    raise InvalidInput(f"bag {bag.path.name}", "shorter than it says", "a complete bag")


def _named(bag: Bag, topic: BagTopic, digest: str, number: int) -> bytes:
    """The description of this digest; InvalidInput if the bag does not have it."""
    for _, raw in bag.messages((topic,)):
        if sensor_message.digest(cdr.read_text(raw)) == digest:
            return raw
    raise InvalidInput(f"sketch/sensor of frame {number}", "missing", f"the description sensor_{digest}")


def _content(bag: Bag, topic: BagTopic) -> str:
    """What the first message of a topic holds: a key of CODECS, "sketch", "sensor", or else ""."""
    if topic.type not in (CLOUD, IMAGE, TEXT):
        return ""
    raw = next((raw for _, raw in bag.messages((topic,))), b"")    # a bag may lie about its messages
    with suppress(InvalidInput):
        if topic.type == CLOUD:
            cloud = cdr.read_cloud(raw)
            is_photons = PHOTON_FIELDS <= {field.name for field in cloud.fields}
            return "photons" if is_photons else "sketch" if sketch_message.is_sketch(cloud) else ""
        if topic.type == IMAGE:
            encoding = cdr.read_image(raw).encoding
            bins = HISTOGRAMS_ENCODING.fullmatch(encoding)
            is_histograms = bins is not None and int(bins[1]) > MOST_CAMERA_CHANNELS
            return "gates" if encoding == GATES_ENCODING else "histograms" if is_histograms else ""
        sensor_message.decode_cdr(raw)
        return "sensor"
    return ""


def _the_only(candidates: list[BagTopic], what: str, bag: Bag) -> BagTopic:
    require(len(candidates) == 1, f"bag {bag.path.name}", f"with {len(candidates)} topics of {what}",
            f"one (`srt3d reconstruct` takes --photons-topic); it has {bag.content()}")
    return candidates[0]
