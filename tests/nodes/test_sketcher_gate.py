"""The sketcher's gate: fixed, live, and one that follows the photons, with all that comes after it."""

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.gate import Gate
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import gates as gates_message
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED

STAMP_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000


@pytest.fixture
def start(graph, sensor):
    """Starts a sketcher that knows the sensor: (process, its descriptions, its sketches, publisher of its photons)."""
    def start(**parameters) -> tuple:
        sketches, descriptions = graph.collect(PointCloud2, "sketch"), graph.collect_latched(String, "sketch/sensor")
        process = graph.start("sketcher", lossless=True, **parameters).ready()
        photons = graph.matched(graph.publisher(PointCloud2, "photons"))
        graph.node.create_publisher(String, "sensor", LATCHED).publish(sensor_message.encode(sensor))
        graph.wait(lambda: descriptions, "sketch/sensor")
        return process, descriptions, sketches, photons

    return start


def message(sensor, depth: float, stamp_ns: int, dtype=np.uint16) -> tuple[PhotonEvents, bytes]:
    """40 photons a pixel of a plane at a depth, and 80 of the background."""
    rng = np.random.default_rng(stamp_ns)
    pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), 120)
    toa = np.where(rng.random(len(pixel)) < 2 / 3, rng.uniform(0, sensor.num_bins, len(pixel)),
                   rng.normal(depth, 2, len(pixel))).clip(0, sensor.num_bins - 1)
    events = PhotonEvents(pixel, toa.astype(dtype), stamp_ns)
    return events, photons_message.encode_cdr(events, sensor, "spad")


def described(text: String) -> tuple[int, float, tuple[int, ...]]:
    """T, offset and frequencies of a description."""
    sensor, frequencies, _ = sketch_message.decode_sensor(text)
    return sensor.num_bins, sensor.toa_offset_bins, frequencies


def test_a_fixed_gate_for_photons_floats_and_gates_with_every_photon_accounted_for(graph, sensor, start):
    _, descriptions, sketches, photons = start(gate="[30, 69]", frequencies="1,2,5", window_frames=2)
    assert described(descriptions[0]) == (40, 30.0, (1, 2, 5))
    gate, sent, kept, before = Gate(sensor, 30, 69), 0, 0, None
    cycles = graph.matched(graph.publisher(Image, "gates"))
    for k, dtype in enumerate((np.uint16, np.float32, "gates")):
        events, data = message(sensor, 50, STAMP_NS + k, np.uint16 if dtype == "gates" else dtype)
        if dtype == "gates":
            cycles.publish(gates_message.encode_cdr(PhotonGates.from_events(events, sensor), sensor, "spad"))
        else:
            photons.publish(data)
        graph.wait(lambda: len(sketches) == k + 1, f"the sketch of {dtype}")
        expected = sketch_photons(events, sensor, (1, 2, 5), gate)
        sent, kept = sent + events.photons, kept + int(expected.photons.sum())
        window = expected if before is None else before + expected
        _, sketch = sketch_message.decode_cdr(serialize_message(sketches[k]), (1, 2, 5), gate.sensor)
        np.testing.assert_array_equal(sketch.photons, window.photons)
        np.testing.assert_allclose(sketch.sums, window.sums, atol=1e-2)
        before = expected
    report = graph.reports("sketcher", "frames_out", 3)
    assert (int(report["photons"]), int(report["photons_dropped.gate"])) == (kept, sent - kept)
    assert report["dropped"] == "0" and report["gate"].startswith("30:69, 0.4497 to 1.034 m")
    assert report["num_bins"] == "40"


def test_a_gate_changes_live_and_is_refused_in_one_line(graph, start):
    _, descriptions, _, _ = start()

    def set_gate(value):
        change = Parameter("gate", value=value).to_parameter_msg()
        return graph.call(SetParametersAtomically, "sketcher/set_parameters_atomically",
                          SetParametersAtomically.Request(parameters=[change])).result

    for value, bins in (("20:79", 60), ([40, 89], 50), (False, 100), ("10, 60", 51)):      # as YAML reads off
        assert set_gate(value).successful
        graph.reports("sketcher", "num_bins", bins)
    gates = [described(text)[:2] for text in descriptions]
    assert gates == [(100, 0.0), (60, 20.0), (50, 40.0), (100, 0.0), (51, 10.0)]
    for value, reason in (("50:100", "gate is 50:100: expected first and last within the sensor's bins, 0 to 99"),
                          ("50:40", "gate is 50:40: expected a first bin below the last"),
                          ("50:60", "gate is 50:60: expected 15 bins or more, as many as the IRF has"),
                          ("50:66", "sketch_size is 10: expected 1 to 8 for T = 17 bins"),
                          ("wide", "gate is wide: expected off, auto, or first and last bin such as 100:400"),
                          (True, "gate is True: expected off, auto, or first and last bin such as 100:400")):
        refused = set_gate(value)
        assert not refused.successful and refused.reason == reason
    assert len(descriptions) == 5 and graph.report("sketcher")["errors"] == "0"


def test_auto_follows_the_scene_and_points_keep_their_places(graph, sensor, start):
    clouds = graph.collect(PointCloud2, "points")
    reconstructor = graph.start("reconstructor", lossless=True).ready()
    process, descriptions, _, photons = start(gate="auto")
    depths = [30] * 8 + [75] * 12
    for k, depth in enumerate(depths):
        photons.publish(message(sensor, depth, STAMP_NS + k * SECOND // 2)[1])
        graph.wait(lambda: len(clouds) == k + 1, f"cloud {k}")
        _, cloud = points_message.decode_cdr(serialize_message(clouds[k]))
        ranges = np.linalg.norm(cloud["xyz"], axis=-1)
        seen = ranges[np.isfinite(ranges)]
        if k not in (8, 9, 10, 11):             # until the gate has followed
            assert len(seen) > 150 and abs(np.median(seen) - sensor.range_m(depth)) < sensor.bin_width_m, k
    gates = [described(text)[:2] for text in descriptions]
    assert gates[0] == (100, 0.0) and 3 <= len(gates) <= 4
    bins, first = gates[1]
    assert first <= 25 and 35 <= first + bins <= 60
    bins, first = gates[-1]
    assert first <= 70 and first + bins >= 80
    report = graph.reports("sketcher", "frames_out", len(depths))
    assert report["gate"].startswith(f"{first:.0f}:{first + bins - 1:.0f}, ")
    assert process.text.count(": gate ") == len(gates) - 1 and reconstructor.text.count("sketches: ") == len(gates)
    assert int(report["photons_dropped.gate"]) > 0 and report["dropped"] == "0"
