"""The sketcher and the histograms of a sensor whose bins are not those of its axis."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.gate import Gate
from srt3d_ros.core.histogram_bins import HistogramBins
from srt3d_ros.core.photons import PhotonHistograms
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import histograms
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED

FREQUENCIES = (1, 2, 5)


@pytest.fixture(scope="module")
def coarse(sensor):
    """The sensor, whose histograms have 20 bins of 4 from bin 10.5 on, with crosstalk in the first two."""
    return sensor.replace(histograms=HistogramBins(20, 10.5, 4.0, np.array([5, 2] + [0] * 18, np.float32)))


@pytest.fixture(scope="module")
def frame(coarse):
    """Photons less the ambient light, which leaves negative counts."""
    counts = np.random.default_rng(0).poisson(3, (coarse.rows, coarse.cols, 20)).astype(np.int32) - 2
    return PhotonHistograms(counts, 5)


def test_wide_bins_crosstalk_and_negative_counts_are_sketched_as_by_the_core(graph, coarse, frame):
    sketches = graph.collect(PointCloud2, "sketch")
    graph.start("sketcher", gate="[30, 69]", frequencies="1,2,5").ready()
    graph.node.create_publisher(String, "sensor", LATCHED).publish(sensor_message.encode(coarse))
    graph.reports("sketcher", "num_bins", 40)
    graph.matched(graph.publisher(Image, "histograms")).publish(histograms.encode_cdr(frame, coarse, "tof"))
    graph.wait(lambda: sketches, "the sketch")
    gate = Gate(coarse, 30, 69)
    expected = sketch_photons(frame, coarse, FREQUENCIES, gate)
    header, sketch = sketch_message.decode_cdr(serialize_message(sketches[0]), FREQUENCIES, gate.sensor)
    assert (header.stamp_ns, header.frame_id) == (5, "tof")
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    np.testing.assert_allclose(sketch.sums, expected.sums, atol=1e-3)
    report = graph.reports("sketcher", "frames_out", 1)
    assert int(report["photons_in"]) == frame.photons
    assert int(report["photons"]) + int(report["photons_dropped.gate"]) == frame.photons


def test_histograms_that_the_description_does_not_explain_are_refused_in_one_line(graph, sensor, coarse, frame):
    sketches = graph.collect(PointCloud2, "sketch")
    process = graph.start("sketcher", frequencies="1,2,5").ready()
    publisher = graph.matched(graph.publisher(Image, "histograms"))
    publisher.publish(histograms.encode_cdr(frame, coarse, "tof"))
    graph.reports("sketcher", "dropped.no_sensor", 1)
    graph.introduce(sensor)
    publisher.publish(histograms.encode_cdr(frame, coarse, "tof"))
    report = graph.reports("sketcher", "dropped.malformed", 1)
    assert report["last_error"] == "encoding is 32SC20: expected 8UC100 or 16UC100 or 32SC100 or 32FC100"
    assert "frame dropped: encoding is 32SC20" in process.text and "Traceback" not in process.text
    better = coarse.replace(num_bins=120)
    descriptions = graph.node.create_publisher(String, "sensor", LATCHED)
    descriptions.publish(sensor_message.encode(better))
    graph.reports("sketcher", "num_bins", 120)
    publisher.publish(histograms.encode_cdr(frame, better, "tof"))
    graph.wait(lambda: sketches, "the sketch")
