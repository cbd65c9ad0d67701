"""The sketcher's frequencies follow the light and its gate the scene: announced, seldom, and no frame is misread."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message

STAMP_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
BINS = np.arange(160)
EDGE = SensorModel(30, 30, 500, 1e-10, np.exp(-BINS / 40) + 4 * np.exp(-0.5 * ((BINS - 5) / 2)**2), frame_id="spad")
DEPTH = 200.0
BRIGHT, DARK = 200, 4       # photons per pixel, at SBR 2


def plane(sensor: SensorModel, depth: float, sbr: float, ppp: float, stamp_ns: int) -> tuple[PhotonEvents, bytes]:
    """The photons of a plane at a depth bin, and their message."""
    range_m = sensor.range_m(np.full((1, sensor.rows, sensor.cols), depth))
    events, _ = Simulator(StaticScene(range_m), sensor, sbr=sbr, ppp=ppp, seed=stamp_ns % 1000).frame(0)
    events = PhotonEvents(events.pixel, events.toa, stamp_ns)
    return events, photons_message.encode_cdr(events, sensor, "spad")


@pytest.fixture
def start(graph):
    """Starts a pipeline that knows a sensor: (sketcher, its descriptions, sketches, clouds, publisher of photons)."""
    def start(sensor: SensorModel, **parameters) -> tuple:
        descriptions = graph.collect_latched(String, "sketch/sensor")
        sketches, clouds = (graph.collect(PointCloud2, topic) for topic in ("sketch", "points"))
        graph.start("reconstructor")
        sketcher = graph.start("sketcher", **parameters)
        for process in graph.processes:
            process.ready()
        graph.latched("sensor").publish(sensor_message.encode(sensor))
        graph.wait(lambda: descriptions, "sketch/sensor")
        return sketcher, descriptions, sketches, clouds, graph.matched(graph.publisher(PointCloud2, "photons"))

    return start


def ranges_m(cloud: PointCloud2) -> np.ndarray:
    return np.linalg.norm(points_message.decode_cdr(serialize_message(cloud))[1]["xyz"], axis=-1)


def test_no_frame_is_lost_or_misread_while_the_light_comes_and_goes(graph, start):
    sketcher, descriptions, sketches, clouds, photons = start(EDGE)
    light = [BRIGHT if k // 10 % 2 == 0 else DARK for k in range(30)]
    sent = [plane(EDGE, DEPTH, 2, ppp, STAMP_NS + k * SECOND // 4) for k, ppp in enumerate(light)]
    for k, (_, data) in enumerate(sent):
        photons.publish(data)
        graph.wait(lambda: len(clouds) == k + 1, f"cloud {k}")
    for k, cloud in enumerate(clouds):
        error_m = np.abs(ranges_m(cloud) - EDGE.range_m(DEPTH))
        assert len(error_m) > 0.9 * EDGE.pixels
        assert np.median(error_m) < EDGE.bin_width_m * (1 if light[k] == BRIGHT else 4), k
    few, many, *others = (sketch_message.decode_sensor(description)[1] for description in descriptions)
    assert few == choose("auto", EDGE) and many[-1] > 1.3 * few[-1] and len(many) == len(few)
    assert others[:1] == [few] and len(others) <= 3
    for k in range(6):                      # after the first bright frame, all at once
        frequencies = few if k == 0 else many
        header, sketch = sketch_message.decode_cdr(serialize_message(sketches[k]), frequencies, EDGE)
        assert header.stamp_ns == STAMP_NS + k * SECOND // 4
        np.testing.assert_allclose(sketch.sums, sketch_photons(sent[k][0], EDGE, frequencies).sums, atol=1e-2)
    assert sketcher.text.count(f" 10 frequencies up to {many[-1]} for 200 photons per pixel at SBR 2") >= 1
    for name in ("sketcher", "reconstructor"):
        report = graph.reports(name, "frames_out", len(light))
        assert (report["dropped"], report["errors"]) == ("0", "0"), report
    assert float(graph.report("sketcher")["photons_per_pixel"]) > 0 and "sbr" in graph.report("sketcher")


def test_an_automatic_gate_follows_the_scene_and_points_keep_their_places(graph, sensor, start):
    sketcher, descriptions, _, clouds, photons = start(sensor, gate="auto")
    depths = [30] * 8 + [75] * 12
    for k, depth in enumerate(depths):
        photons.publish(plane(sensor, depth, 0.5, 120, STAMP_NS + k * SECOND // 2)[1])
        graph.wait(lambda: len(clouds) == k + 1, f"cloud {k}")
        if k not in (8, 9, 10, 11):             # until the gate has followed
            seen = ranges_m(clouds[k])
            assert len(seen) > 150 and abs(np.median(seen) - sensor.range_m(depth)) < sensor.bin_width_m, k
    gated = [sketch_message.decode_sensor(text)[0] for text in descriptions]
    gates = [(described.toa_offset_bins, described.toa_offset_bins + described.num_bins) for described in gated]
    assert gates[0] == (0.0, 100.0) and 3 <= len(gates) <= 4
    assert gates[1][0] <= 25 and 35 <= gates[1][1] <= 60
    assert gates[-1][0] <= 70 and gates[-1][1] >= 80
    report = graph.reports("sketcher", "frames_out", len(depths))
    assert report["gate"].startswith(f"{gates[-1][0]:.0f}:{gates[-1][1] - 1:.0f}, ")
    assert sketcher.text.count(": gate ") == len(gates) - 1
    assert int(report["photons_dropped.gate"]) > 0 and report["dropped"] == "0"
