"""Managed nodes: each transition, asked for by another process as `ros2 lifecycle` asks for it."""

import signal

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes.topics import LATCHED
from tests.devices import made

STEPS = {"configure": Transition.TRANSITION_CONFIGURE, "activate": Transition.TRANSITION_ACTIVATE,
         "deactivate": Transition.TRANSITION_DEACTIVATE, "cleanup": Transition.TRANSITION_CLEANUP}


@pytest.fixture
def change(graph):
    """Asks a node for a transition; whether it went."""
    def change(name: str, step: str) -> bool:
        transition = Transition(id=STEPS[step]) if step in STEPS else Transition(label=step)
        return graph.call(ChangeState, f"{name}/change_state", ChangeState.Request(transition=transition)).success

    return change


def state(graph, name: str) -> str:
    return graph.call(GetState, f"{name}/get_state", GetState.Request()).current_state.label


def test_without_autostart_a_node_waits_for_its_manager_and_then_works(graph, sensor, events, change):
    node = graph.start("sketcher", autostart=False).says("unconfigured, as autostart is false: ros2 lifecycle set")
    graph.node.create_publisher(String, "sensor", LATCHED).publish(sensor_message.encode(sensor))
    photons, sketches = graph.publisher(PointCloud2, "photons"), graph.collect(PointCloud2, "sketch")
    assert state(graph, "sketcher") == "unconfigured"
    assert not graph.node.get_publishers_info_by_topic(f"{graph.namespace}/sketch")
    assert change("sketcher", "configure") and state(graph, "sketcher") == "inactive"
    assert graph.reports("sketcher", "state", "inactive")["message"] == "inactive"
    assert photons.get_subscription_count() == 0
    name, refused = f"{graph.namespace}/sketcher", graph.call(Trigger, "sketcher/reset", Trigger.Request())
    assert (refused.success, refused.message) == (
        False, f"{name} is inactive: ros2 lifecycle set {name} activate")
    assert change("sketcher", "activate")
    node.says("]: ready")
    graph.reports("sketcher", "rows", sensor.rows)
    graph.matched(photons).publish(photons_message.encode_cdr(events, sensor, "spad"))
    graph.wait(lambda: sketches, "a sketch")
    assert node.end(signal.SIGTERM) == 0


def test_deactivated_a_node_leaves_its_inputs_and_goes_on_where_it_is_activated_again(graph, sensor, events, change):
    node = graph.start("reconstructor", lossless=True).ready()
    sketch = sketch_photons(events, sensor, choose("auto", sensor, 10))
    graph.node.create_publisher(String, "sketch/sensor", LATCHED).publish(
        sketch_message.encode_sensor(sensor, sketch.frequencies, 1))
    sketches, clouds = graph.publisher(PointCloud2, "sketch"), graph.collect(PointCloud2, "points")
    for round_ in (1, 2):
        graph.reports("reconstructor", "rows", sensor.rows)
        graph.matched(sketches).publish(sketch_message.encode_cdr(sketch, "spad"))
        graph.wait(lambda: len(clouds) == round_, "a cloud")
        assert change("reconstructor", "deactivate") and state(graph, "reconstructor") == "inactive"
        graph.wait(lambda: sketches.get_subscription_count() == 0, "nobody on sketch")
        if round_ == 2:
            assert change("reconstructor", "cleanup") and state(graph, "reconstructor") == "unconfigured"
            graph.wait(lambda: not graph.node.get_publishers_info_by_topic(f"{graph.namespace}/points"), "no points")
            assert change("reconstructor", "configure")
        assert change("reconstructor", "activate")
    assert bytes(clouds[0].data) == bytes(clouds[1].data)
    report = graph.reports("reconstructor", "frames_out", 2)
    assert report["frames_in"] == "2" and report["dropped"] == "0"
    assert node.end(signal.SIGINT) == 0 and "Traceback" not in node.text
    said = [line.split("]: ")[1] for line in node.lines if "]: sketches: " not in line and "computing" not in line]
    again = ["deactivated", "cleaned up", "configured", "ready"]
    assert said == ["ready", "deactivated", "ready", *again, "shutting down"]


def test_a_transition_that_fails_says_why_and_can_be_tried_again(graph, change, tmp_path):
    folder = tmp_path / "later"
    node = graph.start("recorder", autostart=False, path=folder / "out.rrd").says("unconfigured")
    assert not change("recorder", "configure") and state(graph, "recorder") == "unconfigured"
    node.says("path is ")
    graph.wait(lambda: graph.report("recorder").get("last_error", "").startswith("path is "), "the error's report")
    folder.mkdir()
    assert change("recorder", "configure") and change("recorder", "activate")
    assert state(graph, "recorder") == "active" and "Traceback" not in node.text


def test_impossible_transitions_and_services_are_refused_and_a_node_that_is_shut_down_is_finalized(graph, change):
    node = graph.start("recorder", record=False).ready()
    assert not change("recorder", "configure")
    assert not change("recorder", "no such transition")
    assert state(graph, "recorder") == "active" and node.running
    answer = graph.call(Trigger, "recorder/stop_recording", Trigger.Request())
    assert not answer.success
    assert answer.message == "not recording: call ~/start_recording first"
    assert change("recorder", "shutdown") and state(graph, "recorder") == "finalized"
    assert node.end(signal.SIGTERM) == 0
    assert node.text.count("]: finalized") == 1
    assert "shutting down" not in node.text and "Traceback" not in node.text


def test_a_deactivated_device_leaves_its_publisher_and_comes_again(graph, change):
    zmq = pytest.importorskip("zmq")
    with zmq.Context() as context, context.socket(zmq.PUB) as publisher:
        port = publisher.bind_to_random_port("tcp://127.0.0.1")
        frames = graph.collect(Image, "histograms", raw=True)
        graph.start("device", connect=f"tcp://127.0.0.1:{port}").ready()
        message = made.message(made.zones_16(1.0))
        for time in (1, 2):
            graph.reports("device", "connections", time)
            before = len(frames)
            graph.wait(lambda: publisher.send(message) or len(frames) > before, "a frame")
            assert change("device", "deactivate")
            assert change("device", "activate")
        assert change("device", "deactivate") and change("device", "cleanup")
        publisher.setsockopt(zmq.LINGER, 0)
