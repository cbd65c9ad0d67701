"""What a robot's stack asks of any node: parameters set from outside, QoS, simulated time, pipelines side by side."""

import dataclasses

import pytest
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import points as points_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import base
from tests.nodes.conftest import Graph


@pytest.fixture
def sketch(sensor, events):
    return sketch_photons(events, sensor, choose("auto", sensor, 10))


@pytest.fixture
def reconstructor(graph, sensor, sketch):
    """Starts a reconstructor that knows the sensor; returns what sends it the sketch."""
    graph.node.create_publisher(String, "sketch/sensor", base.LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    publisher = graph.publisher(PointCloud2, "sketch")

    def start(**parameters):
        graph.start("reconstructor", lossless=True, **parameters).ready()
        graph.reports("reconstructor", "rows", sensor.rows)
        return lambda: graph.matched(publisher).publish(sketch_message.encode_cdr(sketch, "spad"))

    return start


def set_parameters(graph, node: str, **values) -> list:
    """As `ros2 param set` does."""
    given: list[ParameterMessage] = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return graph.call(SetParameters, f"{node}/set_parameters", SetParameters.Request(parameters=given)).results


def test_parameters_set_from_outside_are_applied_between_frames_or_refused_with_the_reason(graph, reconstructor):
    clouds = graph.collect(PointCloud2, "points")
    send = reconstructor()
    send()
    graph.wait(lambda: len(clouds) == 1, "a cloud")
    results = set_parameters(graph, "reconstructor", fields="full", surfaces=9, lossless=False, frame_id=True)
    assert [result.successful for result in results] == [True, False, False, False]
    assert "9" in results[1].reason and "read-only" in results[2].reason
    send()
    graph.wait(lambda: len(clouds) == 2, "another cloud")
    assert [cloud.point_step for cloud in clouds] == [16, 32]
    assert graph.reports("reconstructor", "frames_out", 2)["dropped"] == "0"


def test_qos_of_every_topic_can_be_overridden(graph):
    name = f"qos_overrides.{graph.namespace}"
    graph.start("sketcher", **{f"{name}/photons.subscription.reliability": "best_effort",
                               f"{name}/sketch.publisher.durability": "transient_local"}).ready()

    def ends(topic: str):
        infos = graph.node.get_subscriptions_info_by_topic, graph.node.get_publishers_info_by_topic
        return [info for get in infos for info in get(f"{graph.namespace}/{topic}")]

    for topic in ("photons", "gates", "sketch"):
        graph.wait(lambda topic=topic: ends(topic), topic)
    photons, gates, sketch = (ends(topic)[0].qos_profile for topic in ("photons", "gates", "sketch"))
    assert (photons.reliability, gates.reliability) == (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE)
    assert sketch.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_latency_is_that_of_simulated_time_where_a_node_uses_it(graph, reconstructor, sketch):
    graph.collect(PointCloud2, "points")
    send = reconstructor(use_sim_time=True)
    now_ns = sketch.stamp_ns + 250_000_000
    clock = graph.matched(graph.node.create_publisher(Clock, "/clock", 10))

    def arrived():
        clock.publish(Clock(clock=Time(sec=now_ns // 10**9, nanosec=now_ns % 10**9)))
        send()
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
