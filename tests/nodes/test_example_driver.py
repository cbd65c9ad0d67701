"""The example driver, which knows nothing of srt3d_ros, is seen through real nodes at the depth that it simulates."""

import re
import signal

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.datasets.sensor_file import open_sensor
from srt3d_ros.messages import points as points_message

DRIVER = "examples/spad_driver.py"
PAGE = "docs/quickstart-driver.md"


def test_it_is_forty_lines_of_rclpy_and_numpy(repository):
    source = (repository / DRIVER).read_text()
    assert len([line for line in source.splitlines() if line.strip()]) <= 40
    assert "srt3d_ros" not in re.sub('""".*?"""', "", source)


def test_the_page_about_it_shows_it(repository):
    assert (repository / DRIVER).read_text() in (repository / PAGE).read_text()


def test_the_page_describes_a_sensor_that_can_be_used(repository, tmp_path):
    description = tmp_path / "my_sensor.json"
    description.write_text(re.search("```json\n(.*?)```", (repository / PAGE).read_text(), re.DOTALL)[1])
    assert open_sensor(description).range_m(152) == pytest.approx(5.696, abs=1e-3)      # as the page says


def test_clouds_of_its_wall_come(graph):
    clouds = graph.collect(PointCloud2, "points")
    for name in ("reconstructor", "sketcher"):
        graph.start(name).ready()
    driver = graph.start(DRIVER)
    graph.wait(lambda: len(clouds) > 3, "clouds")
    header, columns = points_message.decode(clouds[-1])
    range_m = np.linalg.norm(columns["xyz"], axis=1)
    assert header.frame_id == "spad_optical"
    assert len(range_m) == pytest.approx(32 * 32, abs=40)
    assert np.median(range_m) == pytest.approx(80 * 0.0375, abs=0.01)       # bin 80, c/2 · 250 ps a bin
    assert np.percentile(np.abs(range_m - 3), 95) < 0.05
    assert graph.report("sketcher")["last_error"] == ""
    assert driver.end(signal.SIGINT) == 0 and "Traceback" not in driver.text
