"""The photons or sketches in a bag: which of its topics they are on, and single frames of them."""

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from srt3d_ros import json_text
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonGates
from srt3d_ros.datasets.bags.bag import Bag, BagTopic
from srt3d_ros.datasets.options import ASSUMED_FOV, sketch_with_options
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.results import Sketch

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


class BagFrame(NamedTuple):
    """Frame `number` of a bag, and the description of its sensor: of photons the last that came before, of sketches
    the one that they name; None if it is not in the bag. Serialised messages."""

    number: int
    raw: bytes
    description: bytes | None


class BagFrames:
    """The photons or sketches of a bag that is open, frame by frame; a context manager.

    Raises:
        InvalidInput: the bag cannot be read, or has no photons or no sensor.
    """

    def __init__(self, path: str | Path, photons_topic: str = ""):
        self.path = Path(path)
        self._bag = Bag(path)
        try:
            self.topics = topics = find_photons(self._bag, photons_topic)
            require(topics.sensor is not None, f"bag {self.path.name}", "without a sensor",
                    f"a description of the sensor beside {topics.frames.name}; it has {self._bag.content()}")
        except InvalidInput:
            self.close()
            raise
        self._sensor: tuple[bytes, tuple[SensorModel, tuple[str, ...]]] | None = None

    def __enter__(self) -> "BagFrames":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def __len__(self) -> int:
        return self.topics.frames.messages

    def close(self) -> None:
        """Give back the files."""
        self._bag.close()

    def __iter__(self) -> Iterator[BagFrame]:
        """The frames in the order of their recording; raises InvalidInput where the bag breaks off."""
        described = [message.raw for message in self._bag.messages((self.topics.sensor,))]
        named = {sensor_message.digest(cdr.read_text(raw)): raw for raw in described} if self.are_sketches else {}
        newest, number = next(iter(described), None), 0     # one that came late still describes the first frames
        for message in self._bag.messages((self.topics.frames, self.topics.sensor)):
            if message.topic == self.topics.sensor.name:
                newest = message.raw
            else:
                yield BagFrame(number, message.raw, named.get(_digest(message.raw)) if self.are_sketches else newest)
                number += 1
        require(number == len(self) and described, f"bag {self.path.name}", "shorter than it says", "a complete bag")

    def frame(self, number: int) -> BagFrame:
        """A frame; InvalidInput if there is none of that number."""
        require(0 <= number < len(self), "frame", number,
                f"0 to {len(self) - 1}, the messages on {self.topics.frames.name}")
        return next(islice(self, number, None))

    @property
    def are_sketches(self) -> bool:
        """Whether the frames are sketches."""
        return self.topics.output == "sketch"

    def read(self, frame: BagFrame, options: dict) -> Photons | Sketch:
        """Photons or sketch of a frame, with options (options.gathered) in place of what the bag says.

        Raises:
            InvalidInput: it cannot be read; an option that cannot be used.
        """
        if self.are_sketches:
            return sketch_with_options(self._sketch(frame), options)
        sensor, notes = self._described(frame.description)
        photons = CODECS[self.topics.output].decode_cdr(frame.raw, sensor)[1]
        events = photons.to_events(sensor) if isinstance(photons, PhotonGates) else photons
        return Photons(sensor, events, None, f"{self.path.stem}_{frame.number}", notes).with_options(options)

    def _sketch(self, frame: BagFrame) -> Sketch:
        if frame.description is None:
            digest = sketch_message.description_cdr(frame.raw)
            raise InvalidInput(f"sketch/sensor of frame {frame.number}", "missing", f"the description sensor_{digest}")
        sensor, _ = self._described(frame.description)
        return Sketch(**vars(sketch_message.decode_cdr(frame.raw, sensor)[1]) | {"sensor": sensor})

    def _described(self, raw: bytes) -> tuple[SensorModel, tuple[str, ...]]:
        """The sensor, and notes on it; decoded once for all frames that it describes."""
        if self._sensor is None or self._sensor[0] != raw:
            own = json_text.parse(cdr.read_text(raw), "sensor")
            self._sensor = raw, (sensor_message.decode_cdr(raw), () if "projection" in own else (ASSUMED_FOV,))
        return self._sensor[1]


def _digest(raw: bytes) -> str:
    """Of the description that a sketch names; empty if it names none, which is an error when it is read."""
    with suppress(InvalidInput):
        return sketch_message.description_cdr(raw)
    return ""


def _content(bag: Bag, topic: BagTopic) -> str:
    """What the first message of a topic holds: a key of CODECS, "sketch", "sensor", or else ""."""
    if topic.type not in (CLOUD, IMAGE, TEXT):
        return ""
    raw = next((message.raw for message in bag.messages((topic,))), b"")    # a bag may lie about its messages
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
