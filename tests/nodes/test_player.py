"""The player: what it sends, when, and how it ends; with `wait_for`, beside the nodes that it waits for."""


import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import photon_frames, sensor_message

PLAYER = "from srt3d_ros.nodes import player; player"


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file, tmp_path):
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor.replace(frame_id="mast")))
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5,
                         sensor_file=tmp_path / "sensor.json")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.from_json(described[0].data)
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photon_frames.PHOTONS.decode_cdr(serialize_message(frame), sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(np.array_equal(frame.toa, events.toa) for _, frame in decoded)
    player.says(f"first stamp: {stamps[0]} ns")
    assert graph.reports("player", "frames_out", 5)["dropped"] == "0"


def test_nodes_that_do_not_get_ready_are_named_and_no_frame_is_sent(graph, photon_file):
    frames = graph.collect(PointCloud2, "photons")      # another reader is none of those to wait for
    player = graph.start("player", code=f"{PLAYER}.READY_S = 0.5", input=photon_file, wait_for="sketcher", frames=1)
    assert player.code() == 2 and frames == []      # which `srt3d up` does not try again
    name = f"{graph.namespace}/sketcher"[1:]
    assert f"Nodes of wait_for were not ready within 0 s: {name} (no report on" in player.text


def test_a_frame_that_does_not_become_a_cloud_is_named_and_fails_the_run(graph, photon_file):
    player = graph.start("player", code=f"{PLAYER}.SETTLE_S = 2.0", input=photon_file, rate_hz=20.0, frames=4,
                         wait_for="sketcher reconstructor")
    player.says("waiting for")
    graph.start("reconstructor")
    graph.start("sketcher", packets_per_frame=3)
    assert player.code() == 3
    assert "sent 4, of which 1 were lost: 1 clouds; /diagnostics has the drops" in player.text
