"""The player alone: what it sends, when, and how it ends."""

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file,
                                                                          tmp_path):
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor.replace(frame_id="mast")))
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5,
                         sensor_file=tmp_path / "sensor.json")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.from_json(described[0].data)
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photons_message.decode_cdr(serialize_message(frame), sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(np.array_equal(frame.toa, events.toa) for _, frame in decoded)
    assert f"the first frame's stamp is {stamps[0]}" in player.text
    assert graph.reports("player", "frames_out", 5)["dropped"] == "0"
