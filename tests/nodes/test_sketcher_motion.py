"""The sketcher of a sensor that moves: what a SketchStream does with the same packets and the same `odom`."""

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
from srt3d_ros.datasets.simulation.motion_profiles import Measured
from srt3d_ros.messages import odometry, photon_frames, sensor_message, sketch_message
from srt3d_ros.messages.cdr import read_cloud
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
            assert sketch_message.description_of(read_cloud(raw)) == sensor_message.digest(mounted)
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

    said = "frames go on undeskewed: the reports of motion begin or jump within the frame (/"
    for number, instants_ms in enumerate((range(40, 141, 20), range(160, 241, 20))):
        frame(number, *instants_ms)
        level = DiagnosticStatus.WARN if number == 0 else DiagnosticStatus.OK
        assert all(one["level"] == level for one in graph.next_reports("sketcher", 2))
        assert graph.report("sketcher")["message"].startswith(said) == (number == 0)
    assert (node.text.count(said), node.text.count("frames are deskewed again")) == (1, 1)


def test_extrinsics_that_are_no_pose_are_refused_in_one_line(graph):
    node = graph.start("sketcher", motion="odom", extrinsics="1 2 3")
    assert node.code() == 2 and "extrinsics is 1 2 3: expected x y z" in node.text
