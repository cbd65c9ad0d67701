"""Find the topics of photons or sketches in a bag, and read single frames."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from srt3d_ros.core.sketching.photon_frame import PhotonGates
from srt3d_ros.datasets import arrays
from srt3d_ros.datasets.bags.bag import Bag, BagTopic
from srt3d_ros.datasets.options import Options, fields_of, sensor_of
from srt3d_ros.datasets.reading import Reading, Said
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr, sensor_message, sketch_message
from srt3d_ros.messages.photon_frames import CODECS

CLOUD_TYPE, IMAGE_TYPE, STRING_TYPE = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
PHOTON_FIELDS = {"row", "col", "toa"}
GATES_ENCODING = "16UC1"
HISTOGRAMS_ENCODING = re.compile(r"(?:8U|16U|32S|32F)C(\d{1,5})")
NOTED = "projection", "toa_offset_bins", "range_offset_m"       # a note says so if a description lacks them
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
    candidates = [topic for topic in readable if contents[topic] != "sketch"] or readable
    named = [topic for topic in candidates if topic.name.rsplit("/", 1)[-1] == contents[topic]]
    photons = _the_only(named or candidates, "photons", bag)
    is_sketch, described = contents[photons] == "sketch", [one for one in contents if contents[one] == "sensor"]
    sensors = [topic for topic in described if topic.name.endswith("sketch/sensor") == is_sketch]
    sensors = sensors or (described if is_sketch else [])
    namespace = photons.name if is_sketch else photons.name.rsplit("/", 1)[0]
    beside = [topic for topic in sensors if topic.name == f"{namespace}/sensor"]
    sensor = _the_only(beside or sensors, "sensor", bag) if sensors else None
    return PhotonTopics(contents[photons], photons, sensor)


def frames(path: str | Path, numbers: Sequence[int], options: Options, photons_topic: str = ""
           ) -> Iterator[tuple[int, Callable[[], Reading]]]:
    """Yield each number, and a function that reads that message of a bag's topic.

    The bag is read once.

    Args:
        numbers: of messages on the topic, ascending.
        options: from options.gathered; they override the bag, or describe the sensor of a bag without a description.

    Raises:
        InvalidInput: there is no such frame or sensor; from a function, its message cannot be used.
    """
    with Bag(path) as bag:
        topics = find_photons(bag, photons_topic)
        most = topics.frames.messages - 1
        for number in (numbers[0], numbers[-1]):
            require(0 <= number <= most, "frame", number,
                    "; ".join([f"0 to {most}, the messages on {topics.frames.name}", *bag.notes]))
        sensors = () if topics.sensor is None else (topics.sensor,)
        descriptions = _descriptions(bag, sensors, topics.output)
        described = bool(descriptions) or {"rows", "cols", "num_bins"} <= options.known.keys()
        require(described, "bag", problem=f"bag {bag.path.name} has no description of the sensor beside "
                f"{topics.frames.name}: give a file with one (--sensor-file, in Python sensor=), or rows, cols and "
                f"num_bins. It has {bag.content()}.")
        left, count = iter(numbers), 0
        number = next(left)
        for topic, raw in bag.messages((topics.frames, *sensors)):
            if topic != topics.frames.name:
                if topics.output != "sketch":
                    descriptions = {"": raw}
                continue
            if count == number:
                name = f"{bag.path.stem}_{number}"
                yield number, partial(_decoded, topics.output, raw, descriptions, options, name, bag.notes)
                number = next(left, None)
                if number is None:
                    return
            count += 1
    raise InvalidInput("bag", problem=f"bag {bag.path.name} has fewer messages than it states.")


def _descriptions(bag: Bag, sensors: tuple[BagTopic, ...], kind: str) -> dict[str, bytes]:
    """The descriptions of sketches by their digests; of photons the first one, by ""."""
    descriptions = {}
    for _, raw in bag.messages(sensors):
        if kind != "sketch":
            return {"": raw}
        with suppress(InvalidInput):        # a sketch that needs it says that it is missing
            descriptions[sensor_message.digest(cdr.read_text(raw))] = raw
    return descriptions


def _decoded(kind: str, raw: bytes, descriptions: dict[str, bytes], options: Options, name: str, notes: tuple[str, ...]
             ) -> Reading:
    """The photons or sketch in a message: a sketch of the sensor that it names, photons of that before them.

    If the bag describes none: of the sensor that the options describe.
    """
    if descriptions:
        digest = sketch_message.description_of(cdr.CloudMessage.read(raw)) if kind == "sketch" else ""
        require(digest in descriptions, "sketch/sensor",
                problem=f"Frame {name.rpartition('_')[2]} needs the description sensor_{digest}, which is missing.")
        sensor = sensor_message.decode_cdr(descriptions[digest])
    else:
        require(kind != "sketch" or "irf" in options.known, "irf",
                problem="Give irf, or sensor: sketches do not show it.")
        sensor, own = sensor_of(options)[0], {}
    if kind == "sketch":
        sums = sketch_message.decode_cdr(raw, sensor)[1]
        return arrays.with_options(Reading(sums.sensor, sums, None, name, notes), options)
    photons = CODECS[kind].decode_cdr(raw, sensor)[1]
    if descriptions:
        if isinstance(photons, PhotonGates):
            sensor, photons = photons.counted(sensor), photons.to_events(sensor)
            cycles = options.known.get("cycles") or sensor.cycles       # a given sensor has none
            options = options.knowing(cycles=cycles)
        said = json_text.parse(cdr.read_text(descriptions[digest]), "sensor")
        own = {key: value for key, value in fields_of(sensor).items() if key in said or key not in NOTED}
    return arrays.from_frame(photons, options, Said(own, notes, name))


def _content(bag: Bag, topic: BagTopic) -> str:
    """Kind of a topic's first message: a key of CODECS, "sketch", "sensor", or else ""."""
    if topic.type not in (CLOUD_TYPE, IMAGE_TYPE, STRING_TYPE):
        return ""
    raw = next((raw for _, raw in bag.messages((topic,))), b"")    # the stated number of messages may be wrong
    with suppress(InvalidInput):
        if topic.type == CLOUD_TYPE:
            cloud = cdr.CloudMessage.read(raw)
            if PHOTON_FIELDS <= {field.name for field in cloud.fields}:
                return "photons"
            return "sketch" if sketch_message.is_sketch(cloud) else ""
        if topic.type == IMAGE_TYPE:
            encoding = cdr.Image.read(raw).encoding
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
