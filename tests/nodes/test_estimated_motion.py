"""`motion: estimate` of the sketcher: frames are deskewed by their own photons and the clouds before."""

import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.nodes.moving_source import PACKETS

FRAMES = 5


def test_a_walking_sensor_is_deskewed_by_its_own_photons(graph):
    points = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True).ready()
    graph.start("sketcher", packets_per_frame=PACKETS, motion="estimate", motion_timeout_s=10.0, gap_s=10.0,
                lossless=True).ready()
    player = graph.start("player", motion="walk", frames=FRAMES, rate_hz=10.0, ppp=5.0, lossless=True)
    assert player.code() == 0
    graph.wait(lambda: len(points) == FRAMES, "the clouds")
    report = graph.reports("sketcher", "frames_out", FRAMES)
    assert int(report["frames_undeskewed"]) <= 2        # the first ones have no cloud before them
    assert int(report["frames_deskewed"]) >= FRAMES - 2
    assert float(report["motion_m_s"]) == pytest.approx(1, abs=0.2)         # as walk has it
    assert float(report["motion_deg_s"]) == pytest.approx(30, abs=5)


def test_without_clouds_frames_go_on_undeskewed_and_say_why(graph, sensor, events):
    sketches = graph.collect(PointCloud2, "sketch")
    sketcher = graph.start("sketcher", packets_per_frame=2, motion="estimate", gap_s=10.0).ready()
    graph.start("player", frames=6, rate_hz=20.0, ppp=1.0)
    graph.wait(lambda: len(sketches) == 3, "the sketches")
    graph.reports("sketcher", "frames_undeskewed", 3)
    assert "depth shows where surfaces were just before" in sketcher.text
