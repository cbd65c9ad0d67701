"""The photons or sketches in a bag: which of its topics they are on, and single frames of them."""

import re
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonGates
from srt3d_ros.datasets import sketch_file
from srt3d_ros.datasets.bags.bag import Bag, BagTopic, Message
from srt3d_ros.datasets.options import ASSUMED_FOV
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr, json_text
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.results import Sketch

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
PHOTON_FIELDS = {"row", "col", "toa"}
GATES_ENCODING = "16UC1"
HISTOGRAMS_ENCODING = re.compile(r"(?:8U|16U|32S|32F)C(\d{1,5})")
NAMELESS = "broken"             # in place of a digest, of sketches that say none: an error when they are read
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


class Place(NamedTuple):
    """Where a message is in a bag: the one after `skip` others that were recorded on its topic at `time_ns`."""

    time_ns: int
    skip: int


class FramePlace(NamedTuple):
    """Where frame `number` of a bag is, and its sensor's description: of photons the last that came before, of sketches
    the one that they name; None if it is not in the bag."""

    number: int
    frame: Place
    sensor: Place | None


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
        self._sensor: tuple[Place, tuple[SensorModel, tuple[str, ...]]] | None = None

    def __enter__(self) -> "BagFrames":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def __len__(self) -> int:
        return self.topics.frames.messages

    def close(self) -> None:
        """Give back the files."""
        self._bag.close()

    def places(self, first: int = 0) -> Iterator[FramePlace]:
        """Where the frames are, from `first` on, found by one pass through the bag, which goes on as they are taken.

        Raises:
            InvalidInput: the bag breaks off.
        """
        at_time: Counter[tuple[str, int]] = Counter()
        sensors: dict[str, Place] = {}
        waiting, number = deque(), 0        # a sensor that came late still describes the first frames
        for message in self._bag.messages((self.topics.frames, self.topics.sensor)):
            key = message.topic, message.time_ns
            place = Place(message.time_ns, at_time[key])
            at_time[key] += 1
            if message.topic == self.topics.sensor.name:
                sensors[self._digest(message)] = place
            else:
                if number >= first:
                    waiting.append((number, place, self._digest(message)))
                number += 1
            while waiting and waiting[0][2] in (NAMELESS, *sensors):
                *frame, named = waiting.popleft()
                yield FramePlace(*frame, sensors.get(named))
        require(number == len(self) and sensors, f"bag {self.path.name}", "shorter than it says", "a complete bag")
        yield from (FramePlace(*frame, sensors.get(named)) for *frame, named in waiting)

    def place(self, number: int) -> FramePlace:
        """Where a frame is; InvalidInput if there is none of that number."""
        require(0 <= number < len(self), "frame", number,
                f"0 to {len(self) - 1}, the messages on {self.topics.frames.name}")
        return next(self.places(number))

    @property
    def are_sketches(self) -> bool:
        """Whether the frames are sketches."""
        return self.topics.output == "sketch"

    def read(self, place: FramePlace, options: dict) -> Photons | Sketch:
        """A frame, its sketch or its photons, with options (options.gathered) in place of what the bag says.

        Raises:
            InvalidInput: it cannot be read; an option that cannot be used.
        """
        if self.are_sketches:
            return sketch_file.with_options(self._sketch(place), options)
        sensor, notes = self._sensor_at(place.sensor)
        raw = self._raw(self.topics.frames, place.frame)
        frame = CODECS[self.topics.output].decode_cdr(raw, sensor)[1]
        photons = Photons(sensor, frame.to_events(sensor) if isinstance(frame, PhotonGates) else frame, None,
                          f"{self.path.stem}_{place.number}", notes)
        return photons.with_options(options)

    def _sketch(self, place: FramePlace) -> Sketch:
        raw = self._raw(self.topics.frames, place.frame)
        if place.sensor is None:
            digest = sketch_message.description_cdr(raw)
            raise InvalidInput(f"sketch/sensor of frame {place.number}", "missing", f"the description sensor_{digest}")
        sensor, _ = self._sensor_at(place.sensor)
        return Sketch(**vars(sketch_message.decode_cdr(raw, sensor)[1]) | {"sensor": sensor})

    def _digest(self, message: Message) -> str:
        """By what a sketch and its description are paired; the same for all photons and their descriptions."""
        if not self.are_sketches:
            return ""
        if message.topic == self.topics.sensor.name:
            return sensor_message.digest(cdr.read_text(message.raw))
        with suppress(InvalidInput):
            return sketch_message.description_cdr(message.raw)
        return NAMELESS

    def _sensor_at(self, place: Place) -> tuple[SensorModel, tuple[str, ...]]:
        """The sensor, and notes on it; decoded once for all frames that it describes."""
        if self._sensor is None or self._sensor[0] != place:
            raw = self._raw(self.topics.sensor, place)
            own = json_text.parse(cdr.read_text(raw), "sensor")
            self._sensor = place, (sensor_message.decode_cdr(raw), () if "projection" in own else (ASSUMED_FOV,))
        return self._sensor[1]

    def _raw(self, topic: BagTopic, place: Place) -> bytes:
        """A serialised message; only what was recorded at its time is read, if the bag has an index (rosbag2's do)."""
        there = self._bag.messages((topic,), place.time_ns, place.time_ns + 1)
        message = next(islice(there, place.skip, None), None)
        require(message is not None, f"bag {self.path.name}", "another than it was", "one that stays as it is")
        return message.raw


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
