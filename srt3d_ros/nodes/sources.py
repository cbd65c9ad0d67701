"""The sources of the player: a photon file or the simulator, as messages with the times at which they are due."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from heapq import merge
from itertools import takewhile
from math import ceil
from typing import NamedTuple

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from srt3d_ros import datasets
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import SIMULATOR
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS, OPTICAL, Measured, measured
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.messages import photons_message
from srt3d_ros.messages.cdr import NS_PER_S

LATE_NS = NS_PER_S // 2     # frames that are later are skipped, so that the player catches up after a stall
Clock = Callable[[], int]   # gives the nanoseconds since the first message was sent


class Item(NamedTuple):
    """A message to send.

    Args:
        topic: "photons", or one of the source's `others`.
        raw: the serialised message.
        due_ns: when to send it, after the beginning.
        stamp_ns: its stamp, after the beginning.
        skipped: number of late frames that were left out before this one.
    """

    topic: str
    raw: bytes
    due_ns: int
    stamp_ns: int
    skipped: int = 0


class Source(NamedTuple):
    """The messages to play and their sensor.

    Args:
        sensor: of the photons.
        items: yields the messages in the order in which they are due, from the beginning at each call. It skips frames
            that are late by the clock, whole ones, and still yields the number of frames asked for.
        notes: one line for each assumption.
        others: topics of other messages, which report how the sensor moves.
    """

    sensor: SensorModel
    items: Callable[[Clock], Iterator[Item]]
    notes: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


def open_source(parameters: Mapping) -> Source:
    """The source for the player's parameters; InvalidInput if it cannot be played."""
    path, sensor_file = parameters["input"], parameters["sensor_file"]
    require(not is_bag(path), "input", problem=f"input {path} is a bag: play it with `ros2 bag play` or `srt3d play`.")
    require(path != SIMULATOR or not sensor_file, "sensor_file",
            problem=f"sensor_file {sensor_file}: the simulator has a sensor of its own; set input to a photon file.")
    rate_hz, frames = parameters["rate_hz"], parameters["frames"]
    if parameters["motion"] != "off":
        require(path == SIMULATOR, "motion", parameters["motion"], "off, since input is a photon file")
        return _moving(parameters, PACKETS * rate_hz, PACKETS * frames)
    if path == SIMULATOR:
        simulator = Simulator(sensor=default_sensor().replace(cycles=parameters["cycles"] or None),
                              ppp=parameters["ppp"], sbr=parameters["sbr"], seed=parameters["seed"])
        return Source(simulator.sensor, _photons(simulator.sensor, lambda k: simulator.frame(k)[0], rate_hz, frames))
    photons = datasets.read_photons(path, sensor=datasets.open_sensor(sensor_file) if sensor_file else None)
    events = photons.events
    return Source(photons.sensor, _photons(photons.sensor, lambda k: events, rate_hz, frames), photons.notes)


def _photons(sensor: SensorModel, packet: Callable[[int], PhotonEvents], rate_hz: float, packets: int,
             packets_per_frame: int = 1) -> Callable[[Clock], Iterator[Item]]:
    """The `items` of a source that sends only photons: packet(k) is due k / rate_hz after the first.

    Args:
        packets: their number; 0: no end.

    Raises:
        InvalidInput: the first packet cannot be sent.
    """
    # The cache encodes the frame of a file, which repeats, only once.
    encode = lru_cache(1)(lambda events: photons_message.encode_cdr(events, sensor, sensor.frame_id))
    encode(packet(0))
    period_ns = packets_per_frame * NS_PER_S / rate_hz

    def items(elapsed_ns: Clock) -> Iterator[Item]:
        k = sent = 0
        while not packets or sent < packets:
            late_ns = elapsed_ns() - k * NS_PER_S / rate_hz if k % packets_per_frame == 0 else 0
            skipped = int(late_ns / period_ns) if late_ns > LATE_NS else 0
            k += skipped * packets_per_frame
            due_ns = round(k * NS_PER_S / rate_hz)
            yield Item("photons", encode(packet(k)), due_ns, due_ns, skipped)
            k, sent = k + 1, sent + 1
    return items


PACKETS = 10            # per frame of the moving sensor
ODOM_HZ = 100.0
BEFORE_S, AFTER_S = 0.5, 0.2        # odometry begins BEFORE_S before the photons and ends AFTER_S after them
FIXED, BODY = "odom", "base_link"


def _moving(parameters: Mapping, rate_hz: float, packets: int) -> Source:
    """The simulator's room seen by a moving sensor: packets, sent once they are acquired, and odometry.

    Args:
        rate_hz: of the packets, PACKETS a frame.
        packets: their number; 0: no end.
    """
    path, cycles = MOTIONS[parameters["motion"]], ceil(parameters["cycles"] / PACKETS)
    sensor = moving_sensor().replace(cycles=cycles or None)
    simulator = Simulator(MovingView(Room(), path, sensor, 1 / rate_hz), sensor, parameters["sbr"],
                          parameters["ppp"] / PACKETS, parameters["seed"], rate_hz)
    photons = _photons(sensor, lambda k: simulator.frame(k)[0], rate_hz, packets, PACKETS)
    ahead_ns = round((BEFORE_S + 1 / rate_hz) * NS_PER_S)      # `photons` is due this much before `acquired` sends it

    def acquired(packet: Item) -> Item:
        begun_ns = packet.stamp_ns + round(BEFORE_S * NS_PER_S)
        return packet._replace(due_ns=begun_ns + round(NS_PER_S / rate_hz), stamp_ns=begun_ns)

    def reported(report: Measured) -> Item:
        stamp_ns = round((report.at_s + BEFORE_S) * NS_PER_S)
        return Item("odom", serialize_message(odometry(report)), stamp_ns, stamp_ns)

    def items(elapsed_ns: Clock) -> Iterator[Item]:
        end_ns = float("inf")

        def in_time() -> Iterator[Item]:
            nonlocal end_ns
            for item in map(acquired, photons(lambda: elapsed_ns() - ahead_ns)):
                yield item
            end_ns = item.due_ns + AFTER_S * NS_PER_S

        reports = map(reported, measured(path, ODOM_HZ, start_s=-BEFORE_S))
        both = merge(reports, in_time(), key=lambda item: item.due_ns)
        return takewhile(lambda item: item.due_ns < end_ns, both)

    note = (f"each frame has {PACKETS} packets and odom gives the pose of {BODY}: start the sketcher with motion:=odom "
            f"packets_per_frame:={PACKETS} extrinsics:='{extrinsics()}'")
    return Source(sensor, items, (note,), ("odom",))


def extrinsics() -> str:
    """The pose of the sensor on the body, as text for the sketcher's parameter."""
    return "0 0 0 " + " ".join(f"{number:g}" for number in OPTICAL.quaternion)


def odometry(report: Measured) -> Odometry:
    """The message of a report, without a stamp."""
    message = Odometry(child_frame_id=BODY)
    message.header.frame_id = FIXED
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    speed, rate = message.twist.twist.linear, message.twist.twist.angular
    at.x, at.y, at.z = report.pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = report.pose.quaternion
    speed.x, speed.y, speed.z = report.velocity_m_s.tolist()
    rate.x, rate.y, rate.z = report.rate_rad_s.tolist()
    return message
