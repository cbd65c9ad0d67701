"""What the player plays: a photon file, the simulator or a bag, each as messages that are due one after the other.

Both sources have `items()`, the messages from the beginning, with a sensor only where it changes; `close()`; and
    output      the topic of the frames: "photons", "gates", "histograms" or "sketch"
    describes   "sensor", or of sketches "sketch/sensor"
    others      topics of other messages, which report how the sensor moves
    packets     messages of a frame; 1 if that is not known
    transforms  what was published on /tf_static, each message once
    sensor      the serialised description to begin with, or None
    rate        recorded seconds that pass in one; 0: messages are due as soon as those before are answered
    start_ns    when the recording began; 0 if nothing was recorded
    notes       a line for each assumption
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import NamedTuple

from srt3d_ros import datasets
from srt3d_ros.core.photons import PhotonFrame
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.datasets.bag import Bag, BagTopic, is_bag
from srt3d_ros.datasets.bag_photons import find_photons
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr, photon_frames
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes import topics

SIMULATOR = "simulator"
OVERRIDES = ("num_bins", "bin_width_s", "irf", "fov_deg")
NS_PER_S = 1_000_000_000
AHEAD_NS = NS_PER_S // 5        # reports of the motion come less behind the frames that wait for them, and fit a queue
ALONE_NS = NS_PER_S // 10       # between the turns of a bag with one message


class Item(NamedTuple):
    """A message to send.

    Args:
        topic: that of `output` or of `describes`.
        raw: serialised.
        due_ns: when, at the pace of play, from the beginning.
        acquired_ns: its stamp, from the beginning.
        stamp_ns: its recorded stamp; None for a frame that is sent as if it were acquired now.
        time_ns: when it was recorded; 0 if it was not.
        photons: in it; None if not counted.
    """

    topic: str
    raw: bytes
    due_ns: int
    acquired_ns: int = 0
    stamp_ns: int | None = None
    time_ns: int = 0
    photons: int | None = None


def open_source(parameters: Mapping) -> "FrameSource | BagSource":
    """The source that the player's parameters describe; InvalidInput if it cannot be played."""
    if is_bag(parameters["input"]):
        return BagSource(parameters)
    rate_hz = parameters["rate_hz"]
    require(rate_hz > 0 or parameters["lossless"], "rate_hz", rate_hz,
            "above 0 Hz, or lossless to send as fast as answered")
    require(rate_hz > 0 or not parameters["duration_s"], "rate_hz", rate_hz, "above 0 Hz with duration_s")
    if parameters["input"] == SIMULATOR:
        simulator = Simulator(ppp=parameters["ppp"], sbr=parameters["sbr"], seed=parameters["seed"])
        return FrameSource(simulator.sensor, lambda k: simulator.frame(k)[0], None, parameters)
    overrides = {name: parameters[name] for name in OVERRIDES if parameters[name]}
    photons = datasets.open_photons(parameters["input"], **overrides)
    return FrameSource(photons.sensor, lambda k: photons.frame, None if parameters["loop"] else 1, parameters,
                       photons.notes)


def reports_first(source: "FrameSource | BagSource") -> Iterator[Item]:
    """The items of a source, what reports the motion before the frames of the last AHEAD_NS: they may wait for it."""
    held: deque[tuple[int, Item]] = deque()
    for item in source.items():
        now_ns = item.time_ns or item.due_ns
        while held and not 0 <= now_ns - held[0][0] < AHEAD_NS:     # also where a bag begins again
            yield held.popleft()[1]
        if item.topic in source.others:
            yield item
        else:
            held.append((now_ns, item))
    yield from (item for _, item in held)


class FrameSource:
    """Frames of the simulator, or that of a photon file: frame k is due k / rate_hz after the first.

    Args:
        frame: returns frame k.
        frames: their number; None: there is no end.

    Raises:
        InvalidInput: the first frame cannot be sent.
    """

    start_ns = 0
    describes = "sensor"
    others: tuple[str, ...] = ()
    packets = 1
    transforms: tuple[bytes, ...] = ()

    def __init__(self, sensor: SensorModel, frame: Callable[[int], PhotonFrame], frames: int | None,
                 parameters: Mapping, notes: tuple[str, ...] = ()):
        self.output, self.notes = parameters["output"], notes
        if self.output == "gates" and sensor.gates is None:
            sensor = sensor.replace(gates=GateWords())
        if parameters["frame_id"]:
            sensor = sensor.replace(frame_id=parameters["frame_id"])
        self.sensor = sensor_message.encode_cdr(sensor)
        self._rate_hz = parameters["rate_hz"]
        self.rate = 1.0 if self._rate_hz else 0.0
        self._sensor, self._frame, self._frames = sensor, frame, frames
        if parameters["duration_s"]:
            within = math.ceil(parameters["duration_s"] * self._rate_hz)
            self._frames = within if frames is None else min(frames, within)
        self._encoded: tuple[PhotonFrame, bytes] | None = None
        self._encode(frame(0))

    def items(self) -> Iterator[Item]:
        """Frame after frame."""
        for k in count():
            if k == self._frames:
                return
            frame = self._frame(k)
            due_ns = round(k * NS_PER_S / self._rate_hz) if self._rate_hz else 0
            yield Item(self.output, self._encode(frame), due_ns, due_ns, photons=frame.photons)

    def close(self) -> None:
        """Nothing is open."""

    def _encode(self, frame: PhotonFrame) -> bytes:
        """The message of a frame; that of a file, which repeats, is encoded once."""
        if self._encoded is None or self._encoded[0] is not frame:
            self._encoded = frame, photon_frames.encode_cdr(frame, self.output, self._sensor)
        return self._encoded[1]


class BagSource:
    """The photons of a bag, or its sketches, and the descriptions of their sensor, as and when they were recorded.

    With the photons also what was reported of the sensor's motion, if the bag has one topic of it or one is chosen.

    Raises:
        InvalidInput: the bag cannot be read, the topics are ambiguous, or nothing is left to play.
    """

    packets = 1

    def __init__(self, parameters: Mapping):
        self.rate = parameters["bag_rate"]
        require(self.rate > 0 or parameters["lossless"], "bag_rate", self.rate,
                "above 0, or lossless to send as fast as answered")
        for name in (*OVERRIDES, "frame_id"):
            require(not parameters[name], name, parameters[name], "nothing: a bag is sent as it was recorded")
        self._loop = parameters["bag_loop"]
        self._bag = Bag(parameters["input"])
        found = find_photons(self._bag, parameters["bag_photons_topic"], parameters["bag_sensor_topic"])
        self.output = found.output
        self.describes = "sketch/sensor" if self.output == "sketch" else "sensor"
        reports, self.notes = self._of_motion(parameters)
        self.others = tuple(reports.values())
        self._played_on = reports | {found.frames.name: self.output}        # by topic in the bag
        self._topics = tuple(topic for topic in self._bag.topics
                             if topic == found.sensor or topic.name in self._played_on)
        self.start_ns = next(self._bag.messages(self._topics)).time_ns + round(parameters["bag_start_s"] * NS_PER_S)
        self._duration_ns = round(parameters["duration_s"] * NS_PER_S)
        first = next(self._bag.messages((found.frames,), self.start_ns), None)
        require(first is not None and not self._is_late(first.time_ns), "bag_start_s", parameters["bag_start_s"],
                f"a time after which {found.frames.name} has messages")
        self.sensor = self._sensor_in_force(found.sensor)
        if not self.sensor:
            self.notes += (f"no sensor is described beside {found.frames.name}: another node has to publish it",)
        fixed = [topic for topic in self._bag.topics if topic.type == topics.TF_STATIC.type
                 and topic.name.endswith(topics.TF_STATIC.name)]
        self.transforms = tuple(dict.fromkeys(message.raw for message in self._bag.messages(fixed)))

    def items(self) -> Iterator[Item]:
        """The messages, each turn from the start; raises InvalidInput where the bag is broken."""
        described, begun_ns = self.sensor, 0        # the time played before this turn
        while True:
            if described != self.sensor:
                described = self.sensor
                yield Item(self.describes, described, self._paced(begun_ns), time_ns=self.start_ns)
            for k, message in enumerate(self._bag.messages(self._topics, self.start_ns)):
                passed_ns = message.time_ns - self.start_ns
                if self._is_late(message.time_ns):
                    break
                due_ns, longest_ns = self._paced(begun_ns + passed_ns), passed_ns + passed_ns // max(k, 1)
                if topic := self._played_on.get(message.topic):
                    stamp_ns = _stamp(message.raw, message.time_ns)
                    acquired_ns = self._paced(begun_ns + stamp_ns - self.start_ns)
                    yield Item(topic, message.raw, due_ns, acquired_ns, stamp_ns, message.time_ns)
                elif message.raw != described:
                    described = message.raw
                    yield Item(self.describes, described, due_ns, time_ns=message.time_ns)
            if not self._loop:
                return
            begun_ns += longest_ns or ALONE_NS      # the mean interval after the last message

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()

    def _of_motion(self, parameters: Mapping) -> tuple[dict[str, str], tuple[str, ...]]:
        """The topics in the bag that report a motion, and on which they are played; a line for each choice to make."""
        found, notes = {}, ()
        for report in (topics.ODOM, topics.IMU):
            names = [topic.name for topic in self._bag.topics if topic.type == report.type and topic.messages]
            key = f"bag_{report.name}_topic"
            if given := parameters[key]:
                require(given in names and self.output != "sketch", key, given,
                        f"a topic of {report.type} beside photons; {self._bag.path.name} has {self._bag.content()}")
                names = [given]
            if self.output == "sketch":
                continue
            if len(names) == 1:
                found[names[0]] = report.name
            elif names:
                notes += (f"nothing is played on {report.name}: {key} can be {' or '.join(names)}",)
        return found, notes

    def _sensor_in_force(self, topic: BagTopic | None) -> bytes | None:
        """The last description before the start, or else the first one after it."""
        found = None
        for message in self._bag.messages(() if topic is None else (topic,)):
            if found is not None and message.time_ns > self.start_ns:
                break
            found = message.raw
        return found

    def _is_late(self, time_ns: int) -> bool:
        return bool(self._duration_ns) and time_ns - self.start_ns >= self._duration_ns

    def _paced(self, ns: int) -> int:
        return round(ns / self.rate) if self.rate else 0


def _stamp(raw: bytes, recorded_ns: int) -> int:
    """The stamp of a message, or the time of recording if it has none: the nodes that read it count it as bad."""
    try:
        return cdr.stamp_ns(raw)
    except InvalidInput:
        return recorded_ns
