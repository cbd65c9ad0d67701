"""What is written about the parameters cannot drift from the tables."""

import ast

import pytest

from srt3d_ros.nodes.tables import INTERFACES, generated


@pytest.mark.parametrize("path", generated())
def test_a_generated_file_is_what_the_tables_make(repository, path):
    assert (repository / path).read_text() == generated()[path], "run python -m srt3d_ros.nodes.tables"


@pytest.fixture(scope="module")
def launch(repository):
    """The launch file, parsed. The launch package itself is on no package index."""
    path = repository / "launch" / "srt3d.launch.py"
    compile(path.read_text(), path, "exec")
    return ast.parse(path.read_text())


def calls(tree, name):
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name]


def test_every_launch_argument_has_a_default_and_a_description(launch):
    arguments = calls(launch, "DeclareLaunchArgument")
    assert len(arguments) > 5
    for argument in arguments:
        assert {keyword.arg for keyword in argument.keywords} == {"default_value", "description"}, ast.unparse(argument)


def test_the_launch_file_starts_every_node_with_parameters_and_arguments_that_exist(launch):
    arguments = {ast.literal_eval(call.args[0]) for call in calls(launch, "DeclareLaunchArgument")}
    nodes = [call for call in calls(launch, "node") if call.args]
    assert {ast.literal_eval(call.args[0]) for call in nodes} == set(INTERFACES)
    for call in nodes:
        name, parameters = ast.literal_eval(call.args[0]), ast.literal_eval(call.args[1])
        assert set(parameters) <= {parameter.name for parameter in INTERFACES[name].table}
        assert set(parameters.values()) <= arguments
