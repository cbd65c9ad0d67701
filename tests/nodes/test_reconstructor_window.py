"""Windows of a sensor that moves: photons and odometry of a walk in, clouds of several frames out."""

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.motion_profiles import Measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import Room
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import photon_frames, points_message, sketch_message
from srt3d_ros.nodes import sources
from srt3d_ros.reconstruction import Reconstructor

START_NS, FRAMES, PACKETS, FRAME_S = 1_700_000_000 * 10**9, 8, 2, 0.1
SENSOR = moving_sensor(64)
MOUNTED = SENSOR.replace(extrinsics=sources.extrinsics())


def path(at_s: float) -> Pose:
    return walk(6.55 + at_s)


VIEW = MovingView(Room(), path, SENSOR, FRAME_S / PACKETS)
SIMULATOR = Simulator(VIEW, SENSOR, 0.5, 0.15 / PACKETS, 0, PACKETS / FRAME_S)


def odom(at_s: float, lift_m: float) -> Odometry:
    pose, then = path(at_s), path(at_s + 0.01)
    moved = pose.inverse() @ then
    message = sources.odometry(Measured(at_s, Pose(pose.rotation, pose.translation + [0, 0, lift_m]),
                                        moved.translation * 100, moved.rotation_vector * 100))
    message.header.stamp = Time(nanoseconds=START_NS + round(at_s * 1e9)).to_msg()
    return message


def packet(n: int) -> PhotonEvents:
    photons = SIMULATOR.frame(n)[0]
    return PhotonEvents(photons.pixel, photons.toa, START_NS + photons.stamp_ns)


def true_points(xyz: np.ndarray, row: np.ndarray, col: np.ndarray, k: int) -> int:
    truth = VIEW.at((k + 0.5) * FRAME_S)[0][row, col]
    return int((np.abs(np.linalg.norm(xyz, axis=1) - truth) < 0.1).sum())


def test_clouds_of_a_window_have_more_true_points_than_without_and_it_ends_at_a_jump(graph):
    clouds, sketches = graph.collect(PointCloud2, "points"), graph.collect(PointCloud2, "sketch")
    graph.start("reconstructor", window_frames=10, fields="full").ready()
    graph.start("sketcher", motion="odom", extrinsics=sources.extrinsics(), packets_per_frame=PACKETS).ready()
    graph.introduce(SENSOR)
    photons = graph.matched(graph.publisher(PointCloud2, "photons"))
    reports = graph.matched(graph.publisher(Odometry, "odom"), 2)       # the sketcher's and the reconstructor's
    alone = None

    def frame(number: int, lift_m: float = 0.0) -> tuple[int, int]:
        """True points of the frame's cloud, and of that of its photons alone."""
        nonlocal alone
        for ms in range(-10 if number else -200, 81, 10):
            reports.publish(odom(number * FRAME_S + 0.05 + ms / 1e3, lift_m))
        for n in range(PACKETS):
            photons.publish(photon_frames.PHOTONS.encode_cdr(packet(number * PACKETS + n), SENSOR, "spad"))
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
    windowed, single = frame(FRAMES + 1, lift_m=1.0)
    assert windowed == single
    said = "windows of one frame: the reports of motion begin or jump "
    graph.wait(lambda: graph.report("reconstructor")["message"].startswith(said), said)
