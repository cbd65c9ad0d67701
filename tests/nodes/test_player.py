"""The player alone: what it sends, when, and how it ends."""

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from tests.bags import CLOUD, START_NS, TEXT, write_bag


def test_frames_come_stamped_on_schedule_and_the_player_ends_by_itself(graph, sensor, events, photon_file,
                                                                          tmp_path):
    (tmp_path / "sensor.json").write_text(sensor_message.to_json(sensor.replace(frame_id="mast")))
    frames, described = graph.collect(PointCloud2, "photons"), graph.collect_latched(String, "sensor")
    player = graph.start("player", input=photon_file, rate_hz=50, frames=5,
                         sensor_file=tmp_path / "sensor.json")
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 5, "5 frames")
    sent = sensor_message.decode(described[0])
    assert sent.irf.tolist() == sensor.irf.tolist() and (sent.frame_id, sent.num_bins) == ("mast", 100)
    decoded = [photons_message.decode_cdr(serialize_message(frame), sent) for frame in frames]
    assert {header.frame_id for header, _ in decoded} == {"mast"}
    stamps = [header.stamp_ns for header, _ in decoded]
    assert np.diff(stamps).tolist() == [20_000_000] * 4
    assert all(np.array_equal(frame.toa, events.toa) for _, frame in decoded)
    assert f"the first frame's stamp is {stamps[0]}" in player.text
    assert graph.reports("player", "frames_out", 5)["dropped"] == "0"


def test_a_bag_that_breaks_off_is_one_line_and_exit_code_1(graph, tmp_path, sensor):
    many = PhotonEvents(np.zeros(200_000, np.uint32), np.zeros(200_000, np.uint16), START_NS)
    large = photons_message.encode_cdr(many, sensor, "spad")        # each a chunk of its own
    file = write_bag(tmp_path / "bag", [("/spad/sensor", TEXT, sensor_message.encode_cdr(sensor)), *(
        ("/spad/raw", CLOUD, large, 20 * k) for k in (1, 2, 3))]) / "bag.mcap"
    content = bytearray(file.read_bytes())
    third = content.rindex(large[:100])
    content[third - 30:third - 22] = (2**40).to_bytes(8, "little")      # the length of its record
    file.write_bytes(content)
    described = graph.collect_latched(String, "sensor")
    player = graph.start("player", input=file)
    graph.wait(lambda: described and graph.report("player"), "a description and a report")
    graph.collect(PointCloud2, "photons", raw=True)         # for which the player waits
    assert player.code() == 1
    assert player.text.count("ERROR") == 1 and "bag bag.mcap is unreadable (Truncated record" in player.text
    assert "Traceback" not in player.text
    report = graph.reports("player", "errors", 1)
    assert float(report["latency_p50_ms"]) < 1000       # by the recording's clock; 50 years by the node's
