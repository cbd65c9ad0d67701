"""The sketcher of a sensor that moves: what a SketchStream does with the same packets, `odom`."""

import dataclasses

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sketching.stream import SketchStream, StreamOptions
from srt3d_ros.datasets.simulation.motion_profiles import Measured
from srt3d_ros.messages import odometry
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import sources

MS = 1_000_000
START_NS = 1_700_000_000_000 * MS
SPEED_M_S, TURN_RAD_S = np.array([0.3, 0.0, 1.0]), np.array([0.0, 0.5, 0.0])
PACKET_MS, PACKETS = 25, 4
EXTRINSICS = "0.2 0 0.1 0.5 -0.5 0.5 -0.5"


def odom(ms: float) -> Odometry:
    pose = Pose(Pose.turned(TURN_RAD_S * ms / 1e3).rotation, SPEED_M_S * ms / 1e3)
    message = sources.odometry(Measured(ms / 1e3, pose, SPEED_M_S, TURN_RAD_S))
    message.header.stamp = Time(nanoseconds=START_NS + round(ms * MS)).to_msg()
    return message


class Moving:
    """A sketcher with motion, and a stream that is given the same."""

    def __init__(self, graph, sensor, events, **parameters):
        self.graph, self.sensor, self.events = graph, sensor, events
        self.order = np.array_split(np.random.default_rng(2).permutation(events.photons), PACKETS)
        self.sketches = graph.collect(PointCloud2, "sketch")
        self.process = graph.start("sketcher", motion="odom", packets_per_frame=PACKETS, frequencies="1,3",
                                   **parameters).ready()
        graph.introduce(sensor)
        self.photons = graph.matched(graph.publisher(PointCloud2, "photons"))
        self.reports = graph.matched(graph.publisher(Odometry, "odom"))
        place = Pose.from_quaternion((0.5, -0.5, 0.5, -0.5), (0.2, 0, 0.1)) if "extrinsics" in parameters else Pose()
        self.stream = SketchStream(sensor, StreamOptions(frequencies="1,3", packets_per_frame=PACKETS, moving=True,
                                                         extrinsics=place))

    def report(self, *messages) -> None:
        for message in messages:
            self.reports.publish(message)
            self.stream.add_motion(odometry.decode_odometry(serialize_message(message)))

    def frame(self, number: int) -> list:
        """Send a frame; the sketches of the stream."""
        sketches = []
        for packet in range(number * PACKETS, (number + 1) * PACKETS):
            chosen = np.sort(self.order[packet % PACKETS])
            photons = dataclasses.replace(self.events, pixel=self.events.pixel[chosen], toa=self.events.toa[chosen],
                                          stamp_ns=START_NS + packet * PACKET_MS * MS)
            self.photons.publish(photons_message.encode_cdr(photons, self.sensor, "spad"))
            sketches += self.stream.push(photons)
        return sketches

    def check(self, expected: list) -> None:
        """The next sketches of the node are those of the stream."""
        self.graph.wait(lambda: len(self.sketches) >= len(expected), "the sketches")
        for one in expected:
            _, sketch = sketch_message.decode_cdr(serialize_message(self.sketches.pop(0)), self.sensor)
            assert sketch.stamp_ns == one.stamp_ns
            np.testing.assert_array_equal(sketch.photons, one.photons)
            np.testing.assert_allclose(sketch.z, one.z, atol=2e-4)


@pytest.fixture
def start(graph, sensor, events):
    return lambda **parameters: Moving(graph, sensor, events, **parameters)


def test_a_frame_waits_for_the_odometry_that_covers_it(start, graph):
    moving = start(extrinsics=EXTRINSICS)
    moving.report(*(odom(ms) for ms in range(-20, 61, 20)))
    assert moving.frame(0) == []
    graph.reports("sketcher", "packets_open", 0)
    graph.reports("sketcher", "frames_in", PACKETS)
    assert not moving.sketches
    moving.report(*(odom(ms) for ms in range(80, 141, 20)))
    deskewed = moving.stream.poll()
    assert deskewed[0].stamp_ns == START_NS + 50 * MS
    moving.check(deskewed)
    report = graph.reports("sketcher", "frames_deskewed", 1)
    lost = int(report["photons_dropped.out_of_view"])
    assert lost > 0 and int(report["photons"]) == moving.events.photons - lost


def test_bad_odometry_is_counted_and_told_and_costs_no_frame(start, graph):
    moving = start()
    assert "extrinsics is empty: the sensor is assumed to coincide with the frame that" in moving.process.text
    bad = odom(25)
    bad.pose.pose.position.x = float("nan")
    moving.report(odom(0), odom(20))
    moving.reports.publish(bad)
    moving.reports.publish(odom(10))                    # comes too late
    moving.report(*(odom(ms) for ms in range(40, 121, 20)))
    moving.check(moving.frame(0))
    report = graph.reports("sketcher", "motion_refused", 2)
    assert "/odom: stamp is " in report["last_error"] and "odom: position is " in moving.process.text
    assert "Traceback" not in moving.process.text
    moving.frame(1)                                     # waits for odometry that does not come
    graph.reports("sketcher", "frames_in", 2 * PACKETS)
    assert graph.trigger("sketcher/reset")[0]
    moving.check(moving.stream.reset())
    graph.reports("sketcher", "frames_undeskewed", 1)


def test_what_cannot_go_with_motion_is_refused_in_one_line(graph):
    node = graph.start("sketcher", motion="odom", extrinsics="1 2 3")
    assert node.code() == 2 and "extrinsics is 1 2 3: expected x y z" in node.text
