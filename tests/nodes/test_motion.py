"""Sensors that move: the sketcher does what a SketchStream does with the same odometry, and windows see more."""

import dataclasses

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.stream import SketchStream, StreamOptions
from srt3d_ros.datasets.simulation.motion_profiles import walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import odometry, photon_frames, points_message, sensor_message, sketch_message
from srt3d_ros.messages.cdr import CloudMessage
from srt3d_ros.nodes import sources
from srt3d_ros.reconstruction import Reconstructor

MS = 1_000_000
START_NS = 1_700_000_000_000 * MS
SPEED_M_S, TURN_RAD_S = np.array([0.3, 0.0, 1.0]), np.array([0.0, 0.5, 0.0])
PACKET_MS, PACKETS = 25, 4
EXTRINSICS = "0.2 0 0.1 0.5 -0.5 0.5 -0.5"


def odom(ms: float) -> Odometry:
    message = odometry.encode_odometry(Pose(Pose.turned(TURN_RAD_S * ms / 1e3).rotation, SPEED_M_S * ms / 1e3))
    message.header.stamp = Time(nanoseconds=START_NS + round(ms * MS)).to_msg()
    return message


def packets(events: PhotonEvents, frame: int) -> list[PhotonEvents]:
    parts = np.array_split(np.random.default_rng(2).permutation(events.photons), PACKETS)
    return [dataclasses.replace(events.part(np.sort(part)), stamp_ns=START_NS + (frame * PACKETS + k) * PACKET_MS * MS)
            for k, part in enumerate(parts)]


def test_frames_wait_for_the_odometry_that_covers_them_and_bad_reports_cost_none(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    node = graph.start("sketcher", motion="odom", packets_per_frame=PACKETS, frequencies="1,3",
                       extrinsics=EXTRINSICS).ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    reports = graph.matched(graph.publisher(Odometry, "odom"))
    mounted = sensor.replace(extrinsics=EXTRINSICS)
    stream = SketchStream(mounted, StreamOptions(frequencies="1,3", packets_per_frame=PACKETS, moving=True))

    def report(*instants_ms: float) -> None:
        for message in map(odom, instants_ms):
            reports.publish(message)
            stream.add_motion(odometry.decode_odometry(serialize_message(message)))

    def send(frame: int) -> list:
        for packet in packets(events, frame):
            photons.publish(photon_frames.PHOTONS.encode_cdr(packet, sensor, "spad"))
        return [sketch for packet in packets(events, frame) for sketch in stream.push(packet)]

    def check(expected: list) -> None:
        graph.wait(lambda: len(sketches) >= len(expected), "the sketches")
        for one in expected:
            raw = serialize_message(sketches.pop(0))
            _, sketch = sketch_message.decode_cdr(raw, mounted)
            assert sketch_message.description_of(CloudMessage.read(raw)) == sensor_message.digest(mounted)
            assert sketch.stamp_ns == one.stamp_ns
            np.testing.assert_array_equal(sketch.photons, one.photons)
            np.testing.assert_allclose(sketch.z, one.z, atol=2e-4)

    report(-20, 0, 20)
    bad = odom(25)
    bad.pose.pose.position.x = float("nan")
    reports.publish(bad)
    reports.publish(odom(10))                           # comes too late
    assert send(0) == []
    graph.reports("sketcher", "messages_in", PACKETS)
    assert not sketches
    report(*range(40, 141, 20))
    deskewed = stream.poll()
    assert deskewed[0].stamp_ns == START_NS + 50 * MS   # the middle
    check(deskewed)
    totals = graph.reports("sketcher", "frames_deskewed", 1)
    lost = int(totals["photons_dropped.out_of_view"])
    assert lost > 0 and int(totals["photons"]) == events.photons - lost
    assert "/odom: stamp is " in totals["last_error"] and "odom: position is " in node.text
    send(1)                                             # waits for odometry that does not come
    graph.reports("sketcher", "messages_in", 2 * PACKETS)
    assert graph.change("sketcher", "deactivate")
    check(stream.reset())
    assert graph.reports("sketcher", "frames_undeskewed", 1)["motion_refused"] == "2"
    assert "Traceback" not in node.text


def test_frames_that_go_on_undeskewed_are_a_warning_while_they_do_and_a_line_when_that_changes(graph, sensor, events):
    node = graph.start("sketcher", motion="odom", packets_per_frame=PACKETS, frequencies="1,3").ready()
    graph.introduce(sensor)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    reports = graph.matched(graph.publisher(Odometry, "odom"))

    def frame(number: int, *instants_ms: int) -> dict:
        for ms in instants_ms:
            reports.publish(odom(ms))
        for packet in packets(events, number):
            photons.publish(photon_frames.PHOTONS.encode_cdr(packet, sensor, "spad"))
        return graph.reports("sketcher", "frames_out", number + 1)

    said = "frames go on undeskewed: the reports of motion begin within the frame (/"
    for number, instants_ms in enumerate((range(40, 141, 20), range(160, 241, 20))):
        frame(number, *instants_ms)
        level = DiagnosticStatus.WARN if number == 0 else DiagnosticStatus.OK
        assert all(one["level"] == level for one in graph.next_reports("sketcher", 2))
        assert graph.report("sketcher")["message"].startswith(said) == (number == 0)
    assert (node.text.count(said), node.text.count("frames are deskewed again")) == (1, 1)


FRAMES, HALVES, FRAME_S = 8, 2, 0.1
SENSOR = moving_sensor(64)
MOUNTED = SENSOR.replace(extrinsics=sources.extrinsics())


def path(at_s: float) -> Pose:
    return walk(6.55 + at_s)


VIEW = MovingView(Room(), path, SENSOR, FRAME_S / HALVES)
SIMULATOR = Simulator(VIEW, SENSOR, 0.5, 0.15 / HALVES, 0, HALVES / FRAME_S)


def odom_of_walk(at_s: float, frame_id: str) -> Odometry:
    message = odometry.encode_odometry(path(at_s))
    message.header.stamp, message.header.frame_id = Time(nanoseconds=START_NS + round(at_s * 1e9)).to_msg(), frame_id
    return message


def packet(n: int) -> PhotonEvents:
    photons = SIMULATOR.frame(n)[0]
    return PhotonEvents(photons.pixel, photons.toa, START_NS + photons.stamp_ns)


def true_points(xyz: np.ndarray, row: np.ndarray, col: np.ndarray, k: int) -> int:
    truth = VIEW.at((k + 0.5) * FRAME_S)[0][row, col]
    return int((np.abs(np.linalg.norm(xyz, axis=1) - truth) < 0.1).sum())


def test_clouds_of_a_window_have_more_true_points_than_without_and_it_ends_with_the_trajectory(graph):
    clouds, sketches = graph.collect(PointCloud2, "points"), graph.collect(PointCloud2, "sketch")
    graph.start("reconstructor", window_frames=10, fields="full").ready()
    graph.start("sketcher", motion="odom", extrinsics=sources.extrinsics(), packets_per_frame=HALVES).ready()
    graph.introduce(SENSOR)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    reports = graph.matched(graph.publisher(Odometry, "odom"), 2)       # the sketcher's and the reconstructor's
    alone = None

    def frame(number: int, frame_id: str = "odom") -> tuple[int, int]:
        """True points of the frame's cloud, and of that of its photons alone."""
        nonlocal alone
        for ms in range(-10 if number else -200, 81, 10):
            reports.publish(odom_of_walk(number * FRAME_S + 0.05 + ms / 1e3, frame_id))
        for n in range(HALVES):
            photons.publish(photon_frames.PHOTONS.encode_cdr(packet(number * HALVES + n), SENSOR, "spad"))
        _, points = points_message.decode_cdr(serialize_message(graph.wait(lambda: clouds, "a cloud")[0]))
        _, sketch = sketch_message.decode_cdr(serialize_message(sketches[0]), MOUNTED)
        clouds.clear(), sketches.clear()
        alone = alone or Reconstructor(MOUNTED, sketch.frequencies, device="cpu")
        cloud = alone(sketch)
        return tuple(true_points(*each, number) for each in ((points["xyz"], points["row"], points["col"]),
                                                             (cloud.xyz, cloud.row, cloud.col)))

    found = [frame(k) for k in range(FRAMES)]
    assert found[0][0] == found[0][1]
    assert found[-1][0] > 1.4 * found[-1][1], found
    totals = graph.reports("reconstructor", "frames_out", FRAMES)
    assert totals["motion_restarts"] == totals["motion_refused"] == "0" and "window" not in totals["message"]
    windowed, single = frame(FRAMES + 1, "another")
    assert windowed == single
    said = "windows of one frame: the reports of motion begin "
    graph.wait(lambda: graph.report("reconstructor")["message"].startswith(said), said)
