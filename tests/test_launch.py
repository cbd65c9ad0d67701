"""The launch file starts every node, with parameters and topics that exist.

pip does not install the launch package: what the file takes from it is replaced. tests/test_install.py runs it with it.
"""

import __future__

import ast
import subprocess
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.errors import InvalidInput


@pytest.fixture
def launch(repository) -> SimpleNamespace:
    """What the file defines."""
    foreign = ("launch", "launch_ros")
    own = [line for line in ast.parse((repository / "launch" / "srt3d.launch.py").read_text()).body
           if not isinstance(line, ast.ImportFrom) or line.module.split(".")[0] not in foreign]
    names = {"Node": dict, "ParameterFile": str, "ParameterValue": lambda text, value_type: f"text {text}",
             "Shutdown": lambda reason: reason}
    exec(compile(ast.Module(own, []), "launch", "exec", __future__.annotations.compiler_flag), names)
    return SimpleNamespace(**names)


def test_nodes_get_the_parameters_and_topics_of_the_arguments_and_texts_stay_texts(launch):
    given = {"record": "1.0", "input": "2", "autostart": "false", "config": "srt3d", "points": "/cloud",
             "sketch/sensor": "described", "player.rate_hz": "5", "sketcher.autostart": "true", "device": ""}
    nodes = launch.start(SimpleNamespace(launch_configurations=dict.fromkeys(launch.ARGUMENTS, "") | given))
    assert [(node["name"], node["parameters"][-1]) for node in nodes] == [
        ("recorder", {"path": "text 1.0", "autostart": False}), ("reconstructor", {"autostart": False}),
        ("sketcher", {"autostart": True}),
        ("player", {"input": "text 2", "wait_for": "text sketcher reconstructor recorder", "autostart": False,
                    "rate_hz": 5})]
    for node in nodes:
        assert node["remappings"] == [("sketch/sensor", "described"), ("points", "/cloud")]
        assert node["executable"] == node["name"] and node["parameters"][0].endswith("config/srt3d.yaml")
    assert [(node["respawn"], node["on_exit"]) for node in nodes] == [*3 * [(True, None)],
                                                                      (False, "the player has ended")]


def test_what_does_not_exist_is_refused_and_the_arguments_of_an_including_file_are_left_alone(launch):
    for argument, line in (
            ("sketcher.nonsense", "sketcher has no parameter nonsense: it has sensor_file, sketch_size, "),
            ("sketcher.sketchsize", "sketcher has no parameter sketchsize: did you mean sketch_size?"),
            ("recorder.path", "recorder.path:=5: expected NODE.PARAMETER:=VALUE, NODE one of "),
            ("config", 'config "5": no such parameter file')):
        with pytest.raises(InvalidInput) as refused:
            launch.start(SimpleNamespace(launch_configurations={argument: "5"}))
        assert str(refused.value).startswith(line) and "\n" not in str(refused.value)
    nodes = launch.start(SimpleNamespace(launch_configurations=dict.fromkeys([
        "sketcher.sketch_size", "sketcher.use_sim_time", "sketcher.qos_overrides./x.publisher.depth", "map",
        "nav2.map", "params_file", "ros_namespace", "sketcher.start_type_description_service"], "5")))
    assert [len(node["parameters"][-1]) for node in nodes] == [0, 4]


def test_other_nodes_of_a_launch_inherit_no_variable_from_this_package(repository):
    imports = [ast.unparse(line) for line in ast.parse((repository / "launch" / "srt3d.launch.py").read_text()).body
               if isinstance(line, ast.ImportFrom) and line.module.startswith("srt3d_ros")]
    code = "\n".join(["import os", "before = dict(os.environ)", *imports, "assert os.environ == before"])
    assert imports
    subprocess.run([sys.executable, "-c", code], cwd=repository, env={}, check=True)
