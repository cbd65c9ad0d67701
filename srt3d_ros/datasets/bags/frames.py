"""Find the topics of photons or sketches in a bag, and read single frames."""

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from srt3d_ros.core.sketching.photon_frame import PhotonGates
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.datasets import arrays
from srt3d_ros.datasets.bags.bag import Bag, BagTopic
from srt3d_ros.datasets.options import ASSUMED_FOV, sketch_with_options
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr, sensor_message, sketch_message
from srt3d_ros.messages.photon_frames import CODECS

CLOUD_TYPE, IMAGE_TYPE, STRING_TYPE = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
PHOTON_FIELDS = {"row", "col", "toa"}
GATES_ENCODING = "16UC1"
HISTOGRAMS_ENCODING = re.compile(r"(?:8U|16U|32S|32F)C(\d{1,5})")
MOST_CAMERA_CHANNELS = 4        # an image with more is a histogram: encodings look alike


@dataclass(frozen=True)
class PhotonTopics:
    """Where the photons or sketches of a bag are, and their description if there is one."""

    output: str         # kind of the messages on `frames`: a key of CODECS, or "sketch"
    frames: BagTopic
    sensor: BagTopic | None


def find_photons(bag: Bag, photons_topic: str = "") -> PhotonTopics:
    """Topics of the photons (of sketches if there are none) and of their sensor, found by content.

    If several topics hold photons, take the one whose name is its kind: `photons`, `gates` or `histograms`, in any
    namespace. If several describe a sensor, take `sensor` beside the photons, or `sketch/sensor` beside the sketch.
    Raises InvalidInput, which lists the bag's topics, unless exactly one fits.
    """
    contents = {topic: _content(bag, topic) for topic in bag.topics if topic.messages > 0}
    readable = [topic for topic, content in contents.items()
                if content in (*CODECS, "sketch") and photons_topic in ("", topic.name)]
    require(readable or not photons_topic, "photons_topic", photons_topic,
            f"a topic of photons or sketches; {bag.path.name} has {bag.content()}")
    frames = [topic for topic in readable if contents[topic] != "sketch"] or readable
    named = [topic for topic in frames if topic.name.rsplit("/", 1)[-1] == contents[topic]]
    photons = _the_only(named or frames, "photons", bag)
    is_sketch = contents[photons] == "sketch"
    described = [topic for topic, content in contents.items() if content == "sensor"]
    of_sketches = [topic for topic in described if topic.name.endswith("sketch/sensor")]
    if is_sketch:
        sensors, namespace = of_sketches or described, photons.name
    else:
        sensors, namespace = [topic for topic in described if topic not in of_sketches], photons.name.rsplit("/", 1)[0]
    beside = [topic for topic in sensors if topic.name == f"{namespace}/sensor"]
    sensor = _the_only(beside or sensors, "sensor", bag) if sensors else None
    return PhotonTopics(contents[photons], photons, sensor)


def read_frame(path: str | Path, number: int, options: dict, photons_topic: str = "") -> Photons | Sketch:
    """Photons or sketch in message `number` of a bag's topic.

    Photons use the last description of the sensor before them, or the first one of the bag; a sketch the one it names.
    `options` (options.gathered) override the bag, or describe the sensor of a bag without a description.
    InvalidInput if there is no such frame or sensor.
    """
    with Bag(path) as bag:
        topics = find_photons(bag, photons_topic)
        most = topics.frames.messages - 1
        require(0 <= number <= most, "frame", number,
                "; ".join([f"0 to {most}, the messages on {topics.frames.name}", *bag.notes]))
        raw, description = _frame(bag, topics, number)
        name, notes = f"{bag.path.stem}_{number}", bag.notes
        if description is None:
            require({"rows", "cols", "num_bins"} <= options.keys(), "bag", problem=f"bag {bag.path.name} has no "
                    f"description of the sensor beside {topics.frames.name}: give a file with one (--sensor-file, in "
                    f"Python sensor=), or rows, cols and num_bins. It has {bag.content()}.")
            return _with_given_sensor(topics.output, raw, options, name, notes)
        if topics.output == "sketch":
            description = _named(bag, topics.sensor, sketch_message.description_of(cdr.read_cloud(raw)), number)
    sensor = sensor_message.decode_cdr(description)
    if topics.output == "sketch":
        found = sketch_message.decode_cdr(raw, sensor)[1]
        return sketch_with_options(replace(found, notes=notes), options)
    photons = CODECS[topics.output].decode_cdr(raw, sensor)[1]
    if isinstance(photons, PhotonGates):
        sensor, photons = photons.counted(sensor), photons.to_events(sensor)
    if "projection" not in json_text.parse(cdr.read_text(description), "sensor"):
        notes += (ASSUMED_FOV,)
    return Photons(sensor, photons, None, name, notes).with_options(options)


def _with_given_sensor(kind: str, raw: bytes, options: dict, name: str, notes: tuple[str, ...]) -> Photons | Sketch:
    """The photons or sketch in a message of this kind, of the sensor that the options describe."""
    sensor, _ = arrays.sensor_of(options)
    if kind == "sketch":
        require("irf" in options, "irf", problem="Give irf, or sensor: sketches do not show it.")
        return replace(sketch_message.decode_cdr(raw, sensor)[1], notes=notes)
    sensor, frame, own = arrays.from_frame(CODECS[kind].decode_cdr(raw, sensor)[1], options)
    photons = Photons(sensor, frame, None, name, notes + own)
    return photons.gated(*options["gate"]) if "gate" in options else photons


def _frame(bag: Bag, topics: PhotonTopics, number: int) -> tuple[bytes, bytes | None]:
    """Message `number` of the frames, and the description before it, if the bag has one."""
    sensors = () if topics.sensor is None else (topics.sensor,)
    described = next((raw for _, raw in bag.messages(sensors)), None)
    for topic, raw in bag.messages((topics.frames, *sensors)):
        if topic != topics.frames.name:
            described = raw
        elif number == 0:
            return raw, described
        else:
            number -= 1
    raise InvalidInput("bag", problem=f"bag {bag.path.name} has fewer messages than it states.")


def _named(bag: Bag, topic: BagTopic, digest: str, number: int) -> bytes:
    """The description with this digest."""
    for _, raw in bag.messages((topic,)):
        if sensor_message.digest(cdr.read_text(raw)) == digest:
            return raw
    raise InvalidInput("sketch/sensor",
                       problem=f"Frame {number} needs the description sensor_{digest}, which is missing.")


def _content(bag: Bag, topic: BagTopic) -> str:
    """Kind of a topic's first message: a key of CODECS, "sketch", "sensor", or else ""."""
    if topic.type not in (CLOUD_TYPE, IMAGE_TYPE, STRING_TYPE):
        return ""
    raw = next((raw for _, raw in bag.messages((topic,))), b"")    # the stated number of messages may be wrong
    with suppress(InvalidInput):
        if topic.type == CLOUD_TYPE:
            cloud = cdr.read_cloud(raw)
            if PHOTON_FIELDS <= {field.name for field in cloud.fields}:
                return "photons"
            return "sketch" if sketch_message.is_sketch(cloud) else ""
        if topic.type == IMAGE_TYPE:
            encoding = cdr.read_image(raw).encoding
            if encoding == GATES_ENCODING:
                return "gates"
            bins = HISTOGRAMS_ENCODING.fullmatch(encoding)
            return "histograms" if bins is not None and int(bins[1]) > MOST_CAMERA_CHANNELS else ""
        sensor_message.decode_cdr(raw)
        return "sensor"
    return ""


def _the_only(candidates: list[BagTopic], what: str, bag: Bag) -> BagTopic:
    number = len(candidates)
    advice = ": name one (--photons-topic)" if number > 1 and what == "photons" else ""
    require(number == 1, "bag", problem=f"bag {bag.path.name} has {number or 'no'} topics of {what}{advice}. "
            f"It has {bag.content()}.")
    return candidates[0]
