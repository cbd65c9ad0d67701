"""The sketcher alone: what it publishes, what it survives, what it follows, what it refuses."""

import dataclasses

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.sketcher import PARAMETERS
from tests.nodes.conftest import Graph

STAMP_NS = 1_700_000_000_123_456_789
ATTEMPTS = 5            # to have a description overtake frames
LIVE = {parameter.name: parameter.default for parameter in PARAMETERS if parameter.live}


class Sketcher:
    """A sketcher with its publishers, which the tests of this file share."""

    def __init__(self, graph: Graph):
        self.graph, self.sketches, self._sent = graph, graph.collect(PointCloud2, "sketch"), 0
        self.descriptions = graph.collect_latched(String, "sketch/sensor")
        self._sensor = graph.latched("sensor")
        self._frames = {topic: graph.publisher(PointCloud2 if topic == "photons" else Image, topic)
                        for topic in photon_frames.CODECS}

    def begin(self, sensor: SensorModel) -> None:
        """Describe a sensor to a node whose live parameters are as at its start, and forget what was before."""
        assert self.graph.set("sketcher", **LIVE | {"frequencies": "1,3"}) == ""
        self._sensor.publish(sensor_message.encode(sensor))
        self.graph.reports("sketcher", "num_bins", sensor.num_bins)
        for publisher in self._frames.values():
            self.graph.matched(publisher)
        assert self.graph.trigger("sketcher/reset") == (True, "a new frame begins")
        self._before = self.report()
        self.sketches.clear()

    def described(self, digest: str) -> SensorModel:
        """The description of this name, once it has come."""
        def find():
            sensors = map(sensor_message.decode, self.descriptions)
            return next((sensor for sensor in sensors if sensor_message.digest(sensor) == digest), None)

        return self.graph.wait(find, f"sketch/sensor of {digest}")

    def send(self, message: bytes, topic: str = "photons") -> None:
        self._frames[topic].publish(message)
        self._sent += 1

    def wait_for(self, sketches: int) -> None:
        self.graph.wait(lambda: len(self.sketches) == sketches, f"{sketches} sketches")

    def report(self) -> dict[str, str]:
        """The diagnostics once all that was sent is published, dropped, or in the open frame."""
        def is_settled():
            report = self.graph.report("sketcher")
            total = {key: int(report.get(key, 0)) for key in ("frames_in", "packets", "packets_open", "dropped")}
            return total.pop("frames_in") == self._sent == sum(total.values())

        self.graph.wait(is_settled, f"{self._sent} packets to be published or dropped")
        return self.graph.report("sketcher")

    def counted(self, *names: str) -> list[int]:
        """By how much these totals have risen since `begin`."""
        after = self.report()
        return [int(after.get(name, 0)) - int(self._before.get(name, 0)) for name in names]

    def decoded(self) -> list:
        """Headers and sketches, each by the description that it names."""
        messages = map(serialize_message, self.sketches)
        return [sketch_message.decode_cdr(raw, self.described(sketch_message.description_cdr(raw))) for raw in messages]


@pytest.fixture(scope="module")
def sketcher(shared_graph, tmp_path_factory):
    graph, file = shared_graph, tmp_path_factory.mktemp("parameters") / "a.yaml"
    file.write_text("sketchr: {ros__parameters: {sketch_size: 7}}")
    sketcher = Sketcher(graph)
    sketcher.process = graph.start(
        "sketcher", "-p", f"qos_overrides.{graph.namespace}/sketch.publisher.durability:=transient_local",
        "--params-file", str(file), sketch_sise=3).ready()
    writer, = graph.node.get_publishers_info_by_topic("sketch")
    assert writer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    said = sketcher.process.text
    assert "sketcher has no such parameter, did you mean sketch_size?" in said
    assert f"{file}: parameters of /sketchr are for no node here: did you mean {graph.namespace}/sketcher?" in said
    return sketcher


@pytest.fixture
def photons_at(events, sensor):
    """The message of the events, acquired at a stamp."""
    return lambda stamp_ns: photons_message.encode_cdr(dataclasses.replace(events, stamp_ns=stamp_ns), sensor, "spad")


def test_a_sketch_is_the_cores_and_keeps_stamp_and_frame_for_all_forms(sketcher, sensor, events):
    sketcher.begin(sensor)
    assert sketcher.graph.set("sketcher", gate="30-69") == ""
    expected = sketch_photons(events, sensor, (1, 3), Gate(sensor, 30, 69))
    for k, topic in enumerate(photon_frames.CODECS):
        frame = dataclasses.replace(events, stamp_ns=STAMP_NS + k)
        sketcher.send(photon_frames.encode_cdr(frame, topic, sensor), topic=topic)
        sketcher.wait_for(k + 1)
        header, sketch = sketcher.decoded()[-1]
        assert (header.stamp_ns, header.frame_id) == (STAMP_NS + k, "spad")
        np.testing.assert_array_equal(sketch.photons, expected.photons)
        np.testing.assert_allclose(sketch.sums, expected.sums, atol=1e-2)
    photons_in, photons, outside, dropped = sketcher.counted("photons_in", "photons", "photons_dropped.gate", "dropped")
    assert (photons_in, photons, photons + outside, dropped) == (
        3 * events.photons, 3 * expected.photons.sum(), 3 * events.photons, 0)
    assert sketcher.report()["gate"].startswith("30-69, 0.4497 to 1.034 m")


def test_live_changes_which_the_sensor_may_refuse(sketcher, sensor, photons_at):
    sketcher.begin(sensor)
    assert sketcher.graph.set("sketcher", frequencies="1,4,9", window_frames=5, layout="int16", frame_id="mast") == ""
    sketcher.graph.reports("sketcher", "window_frames", 5)
    sketcher.send(photons_at(STAMP_NS))
    sketcher.wait_for(1)
    assert sketcher.decoded()[0][1].frequencies == (1, 4, 9)
    assert sketcher.sketches[0].header.frame_id == "mast" and sketcher.sketches[0].point_step == 4 + 4 * 3
    for k, (value, bins, first) in enumerate((("20-79", 60, 20), ([40, 89], 50, 40), (False, 100, 0)), 2):
        assert sketcher.graph.set("sketcher", gate=value) == ""             # as YAML reads off, too
        sketcher.graph.reports("sketcher", "num_bins", bins)
        sketcher.send(photons_at(STAMP_NS + k))
        sketcher.wait_for(k)
        described = sketcher.decoded()[-1][1].sensor
        assert (described.num_bins, described.toa_offset_bins) == (bins, first)

    for value, shown in (([1, 2, 5], "1 2 5"), (3, "3")):           # as YAML reads 1,2,5 in brackets, and one number
        assert sketcher.graph.set("sketcher", frequencies=value) == ""
        sketcher.graph.reports("sketcher", "frequencies", shown)
    for values, reason in (({"frequencies": "auto", "sketch_size": 60}, "sketch_size is 60: expected 1 to 49 for T"),
                           ({"frequencies": "1,50"}, "frequencies is 50: expected integers from 1 to 49"),
                           ({"frequencies": "banana"}, "frequencies is banana: expected auto"),
                           ({"gate": "50:60"}, "gate is 50-60: expected 15 bins or more, as many as the IRF has"),
                           ({"gate": "auto"}, "gate is auto: expected off, first and last bin such as 100-400"),
                           ({"gate": True}, "gate is True: expected off, or first and last bin such as 100-400"),
                           ({"packets_per_frame": 0}, "packets_per_frame out of range"),
                           ({"sensor_file": "a.json"}, "read-only")):
        assert reason in sketcher.graph.set("sketcher", **values)
    assert sketcher.counted("errors") == [0]


def test_photons_sent_before_the_description_in_force_are_dropped_and_counted(graph, sensor, photons_at):
    """The same array with wider bins: read with the new description, the plane would be at another range."""
    new, descriptions = sensor.replace(num_bins=128, bin_width_s=2 * sensor.bin_width_s), graph.latched("sensor")
    photons, sketches = graph.publisher(PointCloud2, "photons"), graph.collect(PointCloud2, "sketch")

    def describe(described: SensorModel, wait: bool = True) -> None:
        descriptions.publish(sensor_message.encode(described))
        if wait:
            graph.reports("sketcher", "num_bins", described.num_bins)

    node = graph.start("sketcher", frequencies="1,3").ready()
    graph.matched(photons)
    for attempt in range(1, ATTEMPTS + 1):      # the node may read all before the description arrives
        describe(sensor)
        node.halt()
        for _ in range(3):
            photons.publish(photons_at(STAMP_NS))
        describe(new, wait=False)
        node.go_on()
        graph.reports("sketcher", "num_bins", new.num_bins)
        graph.reports("sketcher", "frames_in", 3 * attempt)
        report = graph.reports("sketcher", "under_way", 0)
        if "dropped.outdated" in report:
            break
    assert "dropped.outdated" in report, report
    graph.wait(lambda: len(sketches) == int(report["frames_out"]), "the sketches of frames that were read before")
    names = f"sensor_{sensor_message.digest(sensor)}"
    assert all(message.fields[-1].name == names for message in sketches)
    photons.publish(photons_at(STAMP_NS))
    graph.wait(lambda: len(sketches) == int(report["frames_out"]) + 1, "the sketch of a frame sent after it")
    assert sketches[-1].fields[-1].name == f"sensor_{sensor_message.digest(new)}"
