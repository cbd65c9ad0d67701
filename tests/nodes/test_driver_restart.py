"""A driver that dies and comes back, as the same sensor or another one: the nodes follow it without a restart."""

from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sensor import GateWords
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message

DRIVER = str(Path(__file__).with_name("driver.py"))


def test_a_killed_driver_that_comes_back_as_another_sensor_is_followed(graph, sensor, tmp_path):
    """Another T, size, IRF and gate words, then the same again; each driver is killed in the middle of a frame."""
    clouds = graph.collect(PointCloud2, "points")
    described = graph.collect_latched(String, "sketch/sensor")
    graph.start("reconstructor", lossless=True)
    graph.start("sketcher", packets_per_frame=2, window_frames=2, lossless=True, sketch_size=5).ready()
    other = sensor.replace(rows=9, cols=21, num_bins=250, irf=np.ones(3), irf_ref=1, gates=GateWords(100, 7))
    plane_m = 0.5                   # what all of them see
    for number, model in enumerate((sensor, other, other), start=1):
        path = tmp_path / f"{number}.json"
        path.write_text(sensor_message.encode(model).data)
        before = len(clouds)
        driver = graph.start(DRIVER, sensor=path, range_m=plane_m, packets=5, start_s=1000.0 * number)
        driver.says("sent 5")
        graph.wait(lambda: len(clouds) == before + 2, f"two clouds of driver {number}")
        graph.reports("sketcher", "frames_in", 5 * number)
        driver.kill()
        for cloud in clouds[before:]:
            assert cloud.header.frame_id == "spad"
            _, found = points_message.decode_cdr(serialize_message(cloud))
            assert len(found["xyz"]) > 0.9 * model.pixels
            assert abs(np.median(np.linalg.norm(found["xyz"], axis=1)) - plane_m) < 2 * model.bin_width_m
    models = [sketch_message.decode_sensor(message)[0] for message in described]
    # twice where the frequencies followed the photons
    assert list(dict.fromkeys(model.num_bins for model in models)) == [100, 250] and models[-1].same_as(other)
    accounting = {"frames_in": "15", "packets": "12", "packets_open": "1", "dropped.incomplete": "2", "dropped": "2",
             "errors": "0"}
    graph.wait(lambda: accounting.items() <= graph.report("sketcher").items(),
               f"{accounting} in the sketcher's diagnostics")
    assert graph.report("reconstructor")["errors"] == "0" and graph.report("reconstructor")["dropped"] == "0"
