"""Parameters: declaration, ranges and validation from one table."""

import itertools

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.common.parameters import Parameter, Parameters

TABLE = (
    Parameter("size", 10, "How many.", "pixels", 1, 100),
    Parameter("rate_hz", 5.0, "How often.", "Hz", 0, 1e3, live=True),
    Parameter("tiny", 1e-7, "How little."),
    Parameter("layout", "float32", "Which type.", choices=("float32", "int16"), live=True),
    Parameter("list", "auto", "Which ones.", form="auto or integers such as 1,2"),
    Parameter("loop", True, "Again and again."),
    Parameter("range", "off", "From where to where.", form="off or two numbers", live=True, loose=True),
)
names = (f"parameters_{k}" for k in itertools.count())


@pytest.fixture
def declare(ros):
    """Declares TABLE on a new node that was given these overrides; returns (node, parameters)."""
    nodes = []

    def declare(**overrides):
        given = [RosParameter(name, value=value) for name, value in overrides.items()]
        nodes.append(Node(next(names), parameter_overrides=given, automatically_declare_parameters_from_overrides=True))
        return nodes[-1], Parameters(nodes[-1], TABLE)

    yield declare
    for node in nodes:
        node.destroy_node()


def test_defaults_and_overrides_of_other_types(declare):
    _, parameters = declare(rate_hz=20, list=3, size=100)
    assert parameters.as_dict() == {"size": 100, "rate_hz": 20.0, "tiny": 1e-7, "layout": "float32", "list": "3",
                                    "loop": True, "range": "off"}
    assert type(parameters["rate_hz"]) is float


@pytest.mark.parametrize("value, text", [(False, "off"), ([3, 40], "3,40"), (7, "7")])
def test_a_loose_text_may_be_what_yaml_makes_of_it_also_live(declare, value, text):
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
    node, parameters = declare()
    parameters.on_check, parameters.on_failure = lambda values: 1 / 0, (failures := []).append
    result, = node.set_parameters([RosParameter("rate_hz", value=1.0)])
    assert not result.successful and "ZeroDivisionError" in result.reason and len(failures) == 1
