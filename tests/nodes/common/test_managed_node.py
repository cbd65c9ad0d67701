"""Managed nodes: their parameters, and each transition, asked for by another process as `ros2 lifecycle` does."""

import itertools
import signal

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from sensor_msgs.msg import PointCloud2

from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import sensor_message, sketch_message
from srt3d_ros.nodes.common.parameters import Parameter, Parameters


def state(graph, name: str) -> str:
    return graph.call(GetState, f"{name}/get_state", GetState.Request()).current_state.label


def test_without_autostart_a_node_waits_for_its_manager_and_works_while_it_is_active(graph, sensor, events):
    node = graph.start("reconstructor", autostart=False).says("unconfigured, as autostart is false")
    sketch = sketch_photons(events, sensor, choose_frequencies("auto", sensor, 10))
    graph.latched("sketch/sensor").publish(sensor_message.encode_cdr(sensor))
    sketches, clouds = graph.publisher(PointCloud2, "sketch"), graph.collect(PointCloud2, "points")
    points = f"{graph.namespace}/points"
    assert state(graph, "reconstructor") == "unconfigured"
    assert not graph.node.get_publishers_info_by_topic(points)
    assert graph.set("reconstructor", background="flat") == "" == graph.set("reconstructor", background="auto")
    assert graph.change("reconstructor", "configure") and state(graph, "reconstructor") == "inactive"
    assert graph.reports("reconstructor", "state", "inactive")["message"] == "inactive"
    assert sketches.get_subscription_count() == 0
    for round_ in (1, 2):
        assert graph.change("reconstructor", "activate")
        graph.matched(sketches).publish(sketch_message.encode_cdr(sketch, "spad"))
        graph.wait(lambda: len(clouds) == round_, "a cloud")
        assert graph.change("reconstructor", "deactivate") and state(graph, "reconstructor") == "inactive"
        graph.wait(lambda: sketches.get_subscription_count() == 0, "nobody on sketch")
        if round_ == 1:
            assert graph.change("reconstructor", "cleanup") and state(graph, "reconstructor") == "unconfigured"
            graph.wait(lambda: not graph.node.get_publishers_info_by_topic(points), "no points")
            assert graph.change("reconstructor", "configure")
    assert bytes(clouds[0].data) == bytes(clouds[1].data)
    report = graph.reports("reconstructor", "frames_out", 2)
    assert (report["messages_in"], report["dropped"], report["errors"]) == ("2", "0", "0")
    assert node.end(signal.SIGINT) == 0 and "Traceback" not in node.text
    said = [line.split("]: ")[1] for line in node.lines if "]: sketches: " not in line and "computing" not in line]
    work = ["configured", "ready", "deactivated"]
    assert said[1:] == [*work, "cleaned up", *work, "shutting down"]


def test_transitions_that_fail_say_why_and_impossible_ones_are_refused(graph, tmp_path):
    folder = tmp_path / "later"
    node = graph.start("recorder", autostart=False, path=folder / "out.rrd").says("unconfigured")
    assert not graph.change("recorder", "configure") and state(graph, "recorder") == "unconfigured"
    node.says("path is ")
    graph.wait(lambda: graph.report("recorder").get("last_error", "").startswith("path is "), "the error's report")
    folder.mkdir()
    assert graph.change("recorder", "configure") and graph.change("recorder", "activate")
    for asked, name in ((Transition(id=Transition.TRANSITION_CONFIGURE), "configure"),  # as Nav2's lifecycle manager
                        (Transition(id=99), "99"), (Transition(label="cleanup"), "cleanup")):
        request = ChangeState.Request(transition=asked)
        assert not graph.call(ChangeState, "recorder/change_state", request).success
        node.says(f"no transition {name} while active")
    assert state(graph, "recorder") == "active" and node.running
    assert graph.change("recorder", "shutdown") and state(graph, "recorder") == "finalized"
    assert node.end(signal.SIGTERM) == 0
    assert node.text.count("]: finalized") == 1
    assert "shutting down" not in node.text and "Traceback" not in node.text


TABLE = (
    Parameter("size", 10, "How many.", "pixels", 1, 100),
    Parameter("rate_hz", 5.0, "How often.", "Hz", 0, 1e3, live=True),
    Parameter("tiny", 1e-7, "How little."),
    Parameter("layout", "float32", "Which type.", choices=("float32", "int16"), live=True),
    Parameter("list", "auto", "Which ones.", form="auto or integers such as 1,2"),
    Parameter("loop", True, "Again and again."),
    Parameter("range", "off", "From where to where.", form="off or two numbers", live=True),
)
names = (f"parameters_{k}" for k in itertools.count())


@pytest.fixture
def declare(ros):
    """Declares TABLE on a new node that was given these overrides; returns (node, parameters)."""
    nodes = []

    def declare(check=lambda values: None, failed=None, **overrides):
        given = [RosParameter(name, value=value) for name, value in overrides.items()]
        nodes.append(Node(next(names), parameter_overrides=given, automatically_declare_parameters_from_overrides=True))
        return nodes[-1], Parameters(nodes[-1], TABLE, check, lambda: None, failed)

    yield declare
    for node in nodes:
        node.destroy_node()


def test_defaults_and_overrides_of_other_types(declare):
    _, parameters = declare(rate_hz=20, list=3, size=100)
    assert parameters.as_dict() == {"size": 100, "rate_hz": 20.0, "tiny": 1e-7, "layout": "float32", "list": "3",
                                    "loop": True, "range": "off"}
    assert type(parameters["rate_hz"]) is float


@pytest.mark.parametrize("value, text", [(False, "off"), ([3, 40], "3,40"), (7, "7")])
def test_a_text_may_be_what_yaml_makes_of_it_also_live(declare, value, text):
    assert declare(range=value)[1]["range"] == text
    node, parameters = declare()
    assert node.set_parameters([RosParameter("range", value=value)])[0].successful and parameters["range"] == text


@pytest.mark.parametrize("value", [20, "20", "2e1", 20.0])
def test_a_number_may_be_what_yaml_makes_of_it_also_live(declare, value):
    node, parameters = declare(rate_hz=value)
    assert parameters["rate_hz"] == 20.0 and node.set_parameters([RosParameter("rate_hz", value=5)])[0].successful
    assert node.set_parameters([RosParameter("rate_hz", value=value)])[0].successful and parameters["rate_hz"] == 20.0
    refused = [node.set_parameters([RosParameter("rate_hz", value=bad)])[0].reason for bad in (2000, "fast", True)]
    assert refused == [f"rate_hz is {bad}: expected a number from 0 to 1000 Hz" for bad in (2000.0, '"fast"', True)]


@pytest.mark.parametrize("name, value, line", [
    ("range", True, "range is True: expected off or two numbers"),
    ("size", 2.5, "size is 2.5: expected an integer from 1 to 100 pixels"),
    ("size", "50", 'size is "50": expected an integer from 1 to 100 pixels'),
    ("rate_hz", float("nan"), "rate_hz is nan: expected a number from 0 to 1000 Hz"),
    ("layout", "int8", "layout is int8: expected float32 or int16"),
    ("loop", "true", 'loop is "true": expected true or false'),
])
def test_a_bad_value_is_one_line_that_names_it(declare, name, value, line):
    with pytest.raises(InvalidInput) as caught:
        declare(**{name: value})
    assert str(caught.value) == line


def test_a_check_that_fails_by_a_mistake_of_ours_refuses_the_value_and_is_reported(declare):
    node, _ = declare(check=lambda values: 1 / 0, failed=(failures := []).append)
    result, = node.set_parameters([RosParameter("rate_hz", value=1.0)])
    assert not result.successful and "ZeroDivisionError" in result.reason and len(failures) == 1
