"""The sketcher's frequencies follow the light: announced, seldom, and no frame is lost or misread through a change."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED

STAMP_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
BINS = np.arange(160)
EDGE = SensorModel(30, 30, 500, 1e-10, np.exp(-BINS / 40) + 4 * np.exp(-0.5 * ((BINS - 5) / 2)**2), frame_id="spad")
DEPTH = 200.0
BRIGHT, DARK = 200, 4       # photons per pixel, at SBR 2


def photons_at(ppp: float, stamp_ns: int) -> tuple[PhotonEvents, bytes]:
    """The photons of a plane, and their message."""
    depth = np.full((1, EDGE.rows, EDGE.cols), DEPTH)
    events, _ = Simulator(StaticScene(EDGE.range_m(depth)), EDGE, sbr=2, ppp=ppp, seed=stamp_ns % 1000).frame(0)
    events = PhotonEvents(events.pixel, events.toa, stamp_ns)
    return events, photons_message.encode_cdr(events, EDGE, "spad")


@pytest.fixture
def start(graph):
    """Starts a sketcher that knows the sensor: (process, its descriptions, publisher of its photons)."""
    def start(**parameters) -> tuple:
        descriptions = graph.collect_latched(String, "sketch/sensor")
        process = graph.start("sketcher", lossless=True, **parameters).ready()
        photons = graph.matched(graph.publisher(PointCloud2, "photons"))
        graph.node.create_publisher(String, "sensor", LATCHED).publish(sensor_message.encode(EDGE))
        graph.wait(lambda: descriptions, "sketch/sensor")
        return process, descriptions, photons

    return start


def frequencies_in(descriptions) -> list[tuple[int, ...]]:
    return [sketch_message.decode_sensor(description)[1] for description in descriptions]


def test_frequencies_rise_after_the_first_bright_frame_and_are_announced_once(graph, start):
    sketches = graph.collect(PointCloud2, "sketch")
    process, descriptions, photons = start()
    sent = [photons_at(BRIGHT, STAMP_NS + k * SECOND // 2) for k in range(6)]
    for k, (_, data) in enumerate(sent):
        photons.publish(data)
        graph.wait(lambda: len(sketches) == k + 1, f"sketch {k}")
    graph.wait(lambda: len(descriptions) == 2, "the description of other frequencies")
    few, many = frequencies_in(descriptions)
    assert few == choose("auto", EDGE) and many[-1] > 1.3 * few[-1] and len(many) == len(few)
    for k, (events, _) in enumerate(sent):
        frequencies = few if k == 0 else many
        _, sketch = sketch_message.decode_cdr(serialize_message(sketches[k]), frequencies, EDGE)
        np.testing.assert_allclose(sketch.sums, sketch_photons(events, EDGE, frequencies).sums, atol=1e-2)
    report = graph.reports("sketcher", "frequencies", " ".join(map(str, many)))
    assert float(report["photons_per_pixel"]) == pytest.approx(BRIGHT, rel=0.05)
    assert float(report["sbr"]) == pytest.approx(2, rel=0.3)
    assert process.text.count(f" 10 frequencies up to {many[-1]} for 200 photons per pixel at SBR 2") == 1
    assert len(descriptions) == 2


def test_frequencies_that_the_user_chose_stay(graph, start):
    sketches = graph.collect(PointCloud2, "sketch")
    _, descriptions, photons = start(frequencies="1,4,9")
    for k in range(2):
        photons.publish(photons_at(BRIGHT, STAMP_NS + k * SECOND)[1])
        graph.wait(lambda: len(sketches) == k + 1, f"sketch {k}")
    report = graph.reports("sketcher", "frames_out", 2)
    assert frequencies_in(descriptions) == [(1, 4, 9)] and "sbr" not in report


def test_no_frame_is_lost_or_misread_while_the_light_comes_and_goes(graph, start):
    clouds = graph.collect(PointCloud2, "points")
    graph.start("reconstructor", lossless=True).ready()
    _, descriptions, photons = start()
    light = [BRIGHT if k // 10 % 2 == 0 else DARK for k in range(40)]
    for k, ppp in enumerate(light):         # as fast as they come, at 4 Hz by their stamps
        photons.publish(photons_at(ppp, STAMP_NS + k * SECOND // 4)[1])
    graph.wait(lambda: len(clouds) == len(light), "a cloud of every frame")
    for k, cloud in enumerate(clouds):
        header, points = points_message.decode_cdr(serialize_message(cloud))
        ranges = np.linalg.norm(points["xyz"], axis=-1)
        assert header.stamp_ns == STAMP_NS + k * SECOND // 4 and len(ranges) > 0.9 * EDGE.pixels
        assert np.median(np.abs(ranges - EDGE.range_m(DEPTH))) < EDGE.bin_width_m * (1 if light[k] == BRIGHT else 4), k
    few, many, *others = frequencies_in(descriptions)
    assert few[-1] < many[-1] and others[:1] == [few] and len(others) <= 4
    for name in ("sketcher", "reconstructor"):
        report = graph.reports(name, "frames_out", len(light))
        assert (report["dropped"], report["errors"]) == ("0", "0"), report
