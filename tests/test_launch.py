"""The launch file starts every node, with parameters and topics that exist.

This reads the file, since pip does not install the launch package. tests/test_install.py runs it where ROS 2 is.
"""

import ast

import pytest

from srt3d_ros.nodes import all_specs


@pytest.fixture(scope="module")
def launch(repository) -> ast.Module:
    return ast.parse((repository / "launch" / "srt3d.launch.py").read_text())


def constant(tree: ast.Module, name: str):
    """The value of a constant at the top of the file."""
    (value,) = (line.value for line in tree.body if isinstance(line, ast.Assign) and line.targets[0].id == name)
    return ast.literal_eval(value)


def test_every_node_is_started_with_parameters_that_it_has(launch):
    nodes = constant(launch, "NODES")
    assert set(nodes) == set(all_specs())
    for name, parameters in nodes.items():
        assert set(parameters) <= {parameter.name for parameter in all_specs()[name].table}
        assert set(parameters.values()) <= set(constant(launch, "ARGUMENTS"))
    assert set(constant(launch, "ONLY_WITH").values()) <= set(constant(launch, "ARGUMENTS"))


def test_every_topic_that_can_be_renamed_is_one_of_the_nodes(launch):
    topics = {topic.name for spec in all_specs().values() for topic in (*spec.inputs, *spec.outputs)}
    assert set(constant(launch, "TOPICS")) <= topics & set(constant(launch, "ARGUMENTS"))
