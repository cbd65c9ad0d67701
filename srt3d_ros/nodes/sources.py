"""What the player plays: a photon file, the simulator or a bag, each as messages that are due one after the other.

Both sources have `items()`, the messages from the beginning, with a sensor only where it changes; `close()`; and
    output      the topic of the frames: "photons", "gates", "histograms" or "sketch"
    describes   "sensor", or of sketches "sketch/sensor"
    others      topics of other messages, which report how the sensor moves
    sensor      the serialised description to begin with, or None
    recorded_ns when the recording began; 0 if nothing was recorded
    notes       a line for each assumption
"""

from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import NamedTuple

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from srt3d_ros import datasets
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photons import PhotonFrame
from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.bags.bag import Bag, is_bag
from srt3d_ros.datasets.bags.frames import find_photons
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS, OPTICAL, Measured, measured
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr, photon_frames
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes import topics

RATE_HZ = 10.0
NOT_OF_BAGS = {"rate_hz": RATE_HZ, "output": "photons", "loop": True}       # and their defaults
NS_PER_S = 1_000_000_000


class Item(NamedTuple):
    """A message to send.

    Args:
        topic: that of `output`, of `describes` or of `others`.
        raw: serialised.
        due_ns: when, from the beginning.
        stamp_ns: as recorded; of what was not recorded, from the beginning.
    """

    topic: str
    raw: bytes
    due_ns: int
    stamp_ns: int = 0


def open_source(parameters: Mapping) -> "FrameSource | BagSource":
    """The source that the player's parameters describe; InvalidInput if it cannot be played."""
    path, sensor_file = parameters["input"], parameters["sensor_file"]
    is_file = path != SIMULATOR and not is_bag(path)
    require(is_file or not sensor_file, "sensor_file", sensor_file, "nothing, unless a photon file is played")
    if parameters["motion"] != "off":
        return MovingSource(parameters)
    if path == SIMULATOR:
        simulator = Simulator(ppp=parameters["ppp"], sbr=parameters["sbr"], seed=parameters["seed"])
        return FrameSource(simulator.sensor, lambda k: simulator.frame(k)[0], None, parameters)
    if not is_file:
        for name, default in NOT_OF_BAGS.items():
            require(parameters[name] == default, name, parameters[name],
                    f"{default}, as a bag is played as it was recorded")
        return BagSource(path)
    photons = datasets.read(path, sensor=datasets.open_sensor(sensor_file) if sensor_file else None)
    return FrameSource(photons.sensor, lambda k: photons.frame, None if parameters["loop"] else 1, parameters,
                       photons.notes)


class FrameSource:
    """Frames of the simulator, or that of a photon file: frame k is due k / rate_hz after the first.

    Args:
        frame: returns frame k.
        frames: their number; None: there is no end.

    Raises:
        InvalidInput: the first frame cannot be sent.
    """

    recorded_ns = 0
    describes = "sensor"
    others: tuple[str, ...] = ()

    def __init__(self, sensor: SensorModel, frame: Callable[[int], PhotonFrame], frames: int | None,
                 parameters: Mapping, notes: tuple[str, ...] = ()):
        self.output, self.notes = parameters["output"], notes
        if self.output == "gates" and sensor.gates is None:
            sensor = sensor.replace(gates=GateWords())
        self.sensor = sensor_message.encode_cdr(sensor)
        self._rate_hz = parameters["rate_hz"]
        self._sensor, self._frame, self._frames = sensor, frame, frames
        self._encoded: tuple[PhotonFrame, bytes] | None = None
        self._encode(frame(0))

    def items(self) -> Iterator[Item]:
        """Frame after frame."""
        for k in count():
            if k == self._frames:
                return
            frame = self._frame(k)
            due_ns = round(k * NS_PER_S / self._rate_hz)
            yield Item(self.output, self._encode(frame), due_ns, due_ns)

    def close(self) -> None:
        """Nothing is open."""

    def _encode(self, frame: PhotonFrame) -> bytes:
        """The message of a frame; that of a file, which repeats, is encoded once."""
        if self._encoded is None or self._encoded[0] is not frame:
            self._encoded = frame, photon_frames.encode_cdr(frame, self.output, self._sensor)
        return self._encoded[1]


class BagSource:
    """The photons of a bag, or its sketches, and the descriptions of their sensor, as and when they were recorded.

    With the photons also what was reported of the sensor's motion, where the bag has one topic of it.

    Raises:
        InvalidInput: the bag cannot be read, or has no photons, or several topics of them.
    """


    def __init__(self, path: str):
        self._bag = Bag(path)
        found = find_photons(self._bag)
        self.output = found.output
        self.describes = "sketch/sensor" if self.output == "sketch" else "sensor"
        reports, self.notes = ({}, ()) if self.output == "sketch" else self._of_motion()
        self.others = tuple(reports.values())
        self._played_on = reports | {found.frames.name: self.output}        # by topic in the bag
        self._topics = tuple(topic for topic in self._bag.topics
                             if topic == found.sensor or topic.name in self._played_on)
        self.recorded_ns = next(self._bag.messages(self._topics)).time_ns
        self.sensor: bytes | None = None
        if found.sensor is None:
            self.notes += (f"no sensor is described beside {found.frames.name}: another node has to publish it",)
        else:
            self.sensor = next(self._bag.messages((found.sensor,))).raw

    def items(self) -> Iterator[Item]:
        """The messages in the order of their recording; raises InvalidInput where the bag is broken."""
        described = self.sensor
        for message in self._bag.messages(self._topics):
            due_ns = message.time_ns - self.recorded_ns
            if topic := self._played_on.get(message.topic):
                yield Item(topic, message.raw, due_ns, _stamp(message.raw, message.time_ns))
            elif message.raw != described:
                described = message.raw
                yield Item(self.describes, described, due_ns)

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()

    def _of_motion(self) -> tuple[dict[str, str], tuple[str, ...]]:
        """The topics in the bag that report a motion, and on which they are played; a line where there are several."""
        found, notes = {}, ()
        for report in (topics.ODOM, topics.IMU):
            names = [topic.name for topic in self._bag.topics if topic.type == report.type and topic.messages]
            if len(names) == 1:
                found[names[0]] = report.name
            elif names:
                notes += (f"nothing is played on {report.name}: the bag has {' and '.join(names)}",)
        return found, notes


def _stamp(raw: bytes, recorded_ns: int) -> int:
    """The stamp of a message, or the time of recording if it has none: the nodes that read it count it as bad."""
    try:
        return cdr.stamp_ns(raw)
    except InvalidInput:
        return recorded_ns


PACKETS = 10            # of a frame
ODOM_HZ = 100.0
BEFORE_S, AFTER_S = 0.5, 0.2        # of the photons: odometry begins so much earlier and ends so much later
FIXED, BODY = "odom", "base_link"


class MovingSource(FrameSource):
    """The simulator's room, seen from a body that moves: each frame in PACKETS packets, sent when they are acquired.

    Raises:
        InvalidInput: no rate, or parameters that cannot be used.
    """

    others = ("odom",)

    def __init__(self, parameters: Mapping):
        rate_hz = PACKETS * parameters["rate_hz"]
        require(parameters["input"] == SIMULATOR, "motion", parameters["motion"], "off, unless input is simulator")
        self._path, sensor = MOTIONS[parameters["motion"]], moving_sensor()
        self._packet_ns = round(NS_PER_S / rate_hz)
        simulator = Simulator(MovingView(Room(), self._path, sensor, 1 / rate_hz), sensor, parameters["sbr"],
                              parameters["ppp"] / PACKETS, parameters["seed"], rate_hz)
        super().__init__(sensor, lambda k: simulator.frame(k)[0], PACKETS * parameters["frames"] or None,
                         {**parameters, "rate_hz": rate_hz}, (
                             f"a frame comes in {PACKETS} packets (the sketcher's packets_per_frame); odom says where "
                             f"{BODY} is, and the sketcher needs extrinsics:='{extrinsics()}'",))

    def items(self) -> Iterator[Item]:
        """Packets and odometry, in the order in which they are sent."""
        reports = self._reports()
        report = next(reports)
        for packet in super().items():
            begun_ns = packet.stamp_ns + round(BEFORE_S * NS_PER_S)
            due_ns = begun_ns + self._packet_ns
            while report.due_ns <= due_ns:
                yield report
                report = next(reports)
            yield packet._replace(due_ns=due_ns, stamp_ns=begun_ns)
        while report.due_ns < due_ns + AFTER_S * NS_PER_S:
            yield report
            report = next(reports)

    def _reports(self) -> Iterator[Item]:
        for report in measured(self._path, ODOM_HZ, start_s=-BEFORE_S):
            stamp_ns = round((report.at_s + BEFORE_S) * NS_PER_S)
            yield Item("odom", serialize_message(odometry(report)), stamp_ns, stamp_ns)


def extrinsics() -> str:
    """Where the sensor is on the body, as the sketcher's parameter says it."""
    return "0 0 0 " + " ".join(f"{number:g}" for number in OPTICAL.quaternion)


def odometry(report: Measured) -> Odometry:
    """The message of a report, not stamped."""
    message = Odometry(child_frame_id=BODY)
    message.header.frame_id = FIXED
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    speed, rate = message.twist.twist.linear, message.twist.twist.angular
    at.x, at.y, at.z = report.pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = report.pose.quaternion
    speed.x, speed.y, speed.z = report.velocity_m_s.tolist()
    rate.x, rate.y, rate.z = report.rate_rad_s.tolist()
    return message
