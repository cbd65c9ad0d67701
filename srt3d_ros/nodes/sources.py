"""What the player plays: a photon file or the simulator, as messages that are due one after the other."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from itertools import count, islice
from typing import NamedTuple

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from srt3d_ros import datasets
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS, OPTICAL, Measured, measured
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message

NS_PER_S = 1_000_000_000


class Item(NamedTuple):
    """A message to send.

    Args:
        topic: "photons", or one of the source's `others`.
        raw: serialised.
        due_ns: when, from the beginning.
        stamp_ns: from the beginning.
    """

    topic: str
    raw: bytes
    due_ns: int
    stamp_ns: int


def open_source(parameters: Mapping) -> "FrameSource":
    """The source that the player's parameters describe; InvalidInput if it cannot be played."""
    path, sensor_file = parameters["input"], parameters["sensor_file"]
    require(not is_bag(path), "input", path, "a photon file or simulator: ros2 bag play plays bags")
    require(path != SIMULATOR or not sensor_file, "sensor_file", sensor_file, "nothing, unless a photon file is played")
    if parameters["motion"] != "off":
        return MovingSource(parameters)
    if path == SIMULATOR:
        simulator = Simulator(ppp=parameters["ppp"], sbr=parameters["sbr"], seed=parameters["seed"])
        return FrameSource(simulator.sensor, lambda k: simulator.frame(k)[0], parameters)
    photons = datasets.read(path, sensor=datasets.open_sensor(sensor_file) if sensor_file else None)
    events = photons.events
    return FrameSource(photons.sensor, lambda k: events, parameters, photons.notes)


class FrameSource:
    """Frames of the simulator, or that of a photon file: frame k is due k / rate_hz after the first.

    Args:
        frame: returns frame k.
        parameters: the player's.

    Attributes:
        others: topics of other messages, which report how the sensor moves.
        sensor: its serialised description.
        notes: a line for each assumption.

    Raises:
        InvalidInput: the first frame cannot be sent.
    """

    others: tuple[str, ...] = ()

    def __init__(self, sensor: SensorModel, frame: Callable[[int], PhotonEvents], parameters: Mapping,
                 notes: tuple[str, ...] = ()):
        self.sensor, self.notes = sensor_message.encode_cdr(sensor), notes
        self._rate_hz, self._frames = parameters["rate_hz"], parameters["frames"] or None
        self._frame = frame
        # Cached: the frame of a file, which repeats, is encoded once.
        self._encode = lru_cache(1)(lambda events: photons_message.encode_cdr(events, sensor, sensor.frame_id))
        self._encode(frame(0))

    def items(self) -> Iterator[Item]:
        """The messages from the beginning."""
        for k in islice(count(), self._frames):
            due_ns = round(k * NS_PER_S / self._rate_hz)
            yield Item("photons", self._encode(self._frame(k)), due_ns, due_ns)


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
        super().__init__(sensor, lambda k: simulator.frame(k)[0],
                         {**parameters, "rate_hz": rate_hz, "frames": PACKETS * parameters["frames"]}, (
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
