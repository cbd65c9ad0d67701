"""The nodes together: every frame arrives, nothing that happens to one node harms another or another pipeline."""

import dataclasses
import signal
from collections import Counter

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from rerun.chunk import RrdReader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED
from tests.nodes.conftest import Graph

NODES = ("recorder", "reconstructor", "sketcher")


def rows_of(recording, entity: str, column: str) -> int:
    """How many times a column of an entity was logged in a recording."""
    count = 0
    for chunk in RrdReader(recording).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        count += batch.num_rows if column in batch.schema.names else 0
    return count


def stamps(clouds) -> list[int]:
    return [cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec for cloud in clouds]


@pytest.fixture
def pipeline(graph, tmp_path):
    """Starts recorder, reconstructor and sketcher; returns them by name. The recording is tmp_path/out.rrd."""
    def pipeline(**parameters):
        own = {"recorder": {"path": tmp_path / "out.rrd"}}
        started = {name: graph.start(name, **own.get(name, {}), **parameters) for name in NODES}
        for process in started.values():
            process.ready()
        return started

    return pipeline


def test_lossless_at_full_speed_brings_and_records_every_frame(graph, pipeline, photon_file, events, tmp_path):
    frames, clouds, recording = 50, graph.collect(PointCloud2, "points"), tmp_path / "out.rrd"
    recording.write_bytes(b"an older one, to be replaced")
    nodes = pipeline(lossless=True)
    player = graph.start("player", input=photon_file, lossless=True, rate_hz=0, frames=frames)
    assert player.code() == 0
    graph.wait(lambda: len(clouds) == frames, "every cloud")
    arrived = stamps(clouds)
    assert arrived == sorted(set(arrived))
    assert str(arrived[0]) == graph.reports("player", "frames_sent", frames)["first_stamp_ns"]
    for name in ("sketcher", "reconstructor"):
        report = graph.reports(name, "frames_out", frames)
        assert (report["frames_in"], report["dropped"], report["message_lost"]) == (str(frames), "0", "0")
        assert int(report["photons"]) == frames * events.photons
    graph.reports("recorder", "clouds", frames)
    for name, number in zip(NODES, (signal.SIGINT, signal.SIGTERM, signal.SIGINT)):
        assert nodes[name].end(number) == 0, nodes[name].text
    assert rows_of(recording, "/points", "Points3D:positions") == frames
    assert rows_of(recording, "/metrics/latency_ms", "Scalars:scalars") == frames
    assert rows_of(recording, "/metrics/photons", "Scalars:scalars") == frames
    assert rows_of(recording, "/metrics/drops", "Scalars:scalars") > 0
    assert Counter(graph.report("recorder")[key] for key in ("errors", "recording_dropped")) == {"0": 2}


def test_a_killed_reconstructor_comes_back_and_nobody_else_notices(graph, pipeline, photon_file, tmp_path):
    clouds = graph.collect(PointCloud2, "points")
    nodes = pipeline()
    player = graph.start("player", input=photon_file, rate_hz=20)
    graph.wait(lambda: len(clouds) > 10, "clouds")
    nodes["reconstructor"].kill()
    before = len(clouds)
    nodes["reconstructor"] = graph.start("reconstructor").ready()
    graph.wait(lambda: len(clouds) > before + 10, "clouds after the restart")
    graph.wait(lambda: graph.total("recorder", "clouds") > 20, "recorded clouds")
    nodes["player"] = player
    assert all(process.running for process in nodes.values())
    for name in ("player", "sketcher", "recorder"):
        assert graph.report(name)["errors"] == "0"
    for name, number in zip((*NODES, "player"), (signal.SIGTERM, signal.SIGINT, signal.SIGTERM, signal.SIGINT)):
        assert nodes[name].end(number) == 0, nodes[name].text       # under load: the player goes on until the last
        assert "Traceback" not in nodes[name].text
    recorded = int(graph.reports("recorder", "state", "finalized")["clouds"])
    assert recorded > 20
    assert rows_of(tmp_path / "out.rrd", "/points", "Points3D:positions") == recorded


def test_latency_is_that_of_simulated_time_where_a_node_uses_it(graph, sensor, events):
    sketch = sketch_photons(events, sensor, choose("auto", sensor, 10))
    graph.node.create_publisher(String, "sketch/sensor", LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    graph.start("reconstructor", use_sim_time=True).ready()
    graph.reports("reconstructor", "rows", sensor.rows)
    sketches = graph.matched(graph.publisher(PointCloud2, "sketch"))
    now_ns = sketch.stamp_ns + 250_000_000
    clock = graph.matched(graph.node.create_publisher(Clock, "/clock", 10))

    def arrived():
        clock.publish(Clock(clock=Time(sec=now_ns // 10**9, nanosec=now_ns % 10**9)))
        sketches.publish(sketch_message.encode_cdr(sketch, "spad"))
        return graph.report("reconstructor").get("latency_p50_ms") == "250.00"

    graph.wait(arrived, "a latency of 250 ms")


def test_two_pipelines_side_by_side_do_not_hear_each_other(graph, sensor, events):
    other, clouds = Graph(), {}
    try:
        sensors = {graph: sensor, other: sensor.replace(rows=sensor.cols, cols=sensor.rows, projection=None,
                                                         frame_id="other")}
        for pipeline, own in sensors.items():
            clouds[pipeline] = pipeline.collect(PointCloud2, "points")
            for name in ("reconstructor", "sketcher"):
                pipeline.start(name, lossless=True, **({"fields": "full"} if name == "reconstructor" else {}))
        for pipeline, own in sensors.items():
            for process in pipeline.processes:
                process.ready()
            pipeline.introduce(own)
            photons = pipeline.matched(pipeline.publisher(PointCloud2, "photons"))
            frame = dataclasses.replace(events, stamp_ns=own.rows)
            photons.publish(photons_message.encode_cdr(frame, own, own.frame_id))
        for pipeline, own in sensors.items():
            pipeline.wait(lambda pipeline=pipeline: clouds[pipeline], "a cloud")
            assert pipeline.reports("reconstructor", "frames_out", 1)["dropped"] == "0"
            (cloud,) = clouds[pipeline]
            header, points = points_message.decode_cdr(serialize_message(cloud))
            assert (header.stamp_ns, header.frame_id) == (own.rows, own.frame_id)
            assert (points["row"].max(), points["col"].max()) == (own.rows - 1, own.cols - 1)
    finally:
        other.close()
