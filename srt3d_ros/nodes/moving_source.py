"""What the player sends of a simulated sensor that moves: packets of photons, and odometry of the body it is on."""

from collections.abc import Iterator, Mapping

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from srt3d_ros.core.motion import Pose
from srt3d_ros.datasets.simulation.motion_profiles import MOTIONS, OPTICAL, Measured, measured
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import require
from srt3d_ros.nodes.sources import NS_PER_S, SIMULATOR, FrameSource, Item

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
    packets = PACKETS

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
    return "0 0 0 " + " ".join(f"{number:g}" for number in quaternion(OPTICAL))


def odometry(report: Measured) -> Odometry:
    """The message of a report, not stamped."""
    message = Odometry(child_frame_id=BODY)
    message.header.frame_id = FIXED
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    speed, rate = message.twist.twist.linear, message.twist.twist.angular
    at.x, at.y, at.z = report.pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = quaternion(report.pose)
    speed.x, speed.y, speed.z = report.velocity_m_s.tolist()
    rate.x, rate.y, rate.z = report.rate_rad_s.tolist()
    return message


def quaternion(pose: Pose) -> tuple[float, float, float, float]:
    """The rotation of a pose as x, y, z, w."""
    vector = pose.rotation_vector
    angle = float(np.linalg.norm(vector))
    half = vector * (np.sin(angle / 2) / max(angle, 1e-12))
    return (*half.tolist(), float(np.cos(angle / 2)))
