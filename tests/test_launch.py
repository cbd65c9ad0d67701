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
from srt3d_ros.processes.supervisor import MOST_RESTARTS, Restarts


@pytest.fixture
def launch(repository) -> SimpleNamespace:
    """What the file defines; `said` gets the lines that it logs."""
    foreign = ("launch", "launch_ros")
    own = [line for line in ast.parse((repository / "launch" / "srt3d.launch.py").read_text()).body
           if not isinstance(line, ast.ImportFrom) or line.module.split(".")[0] not in foreign]
    said = []
    names = {"Node": dict, "ParameterFile": str, "ParameterValue": lambda text, value_type: f"text {text}",
             "said": said, "get_logger": lambda name: SimpleNamespace(warning=said.append, error=said.append),
             "EmitEvent": lambda event: event, "ShutdownProcess": lambda process_matcher: process_matcher,
             "matches_action": lambda action: f"no more {action}", "Shutdown": lambda reason: reason}
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


def test_what_does_not_exist_is_refused_and_a_mistyped_argument_warned_of(launch):
    for argument, line in (
            ("sketcher.nonsense", "sketcher has no parameter nonsense: it has sensor_file, sketch_size, "),
            ("sketcher.sketchsize", "sketcher has no parameter sketchsize: did you mean sketch_size?"),
            ("sketchr.sketch_size", "sketchr.sketch_size:=5: expected NODE.PARAMETER:=VALUE, NODE one of "),
            ("config", 'config "5": no such parameter file')):
        with pytest.raises(InvalidInput) as refused:
            launch.start(SimpleNamespace(launch_configurations={argument: "5"}))
        assert str(refused.value).startswith(line) and "\n" not in str(refused.value)
    launch.start(SimpleNamespace(launch_configurations=dict.fromkeys([      # those of an including file are left alone
        "fotons", "sketcher.sketch_size", "sketcher.use_sim_time", "sketcher.qos_overrides./x.publisher.depth", "map",
        "nav2.map", "params_file", "ros_namespace", "sketcher.start_type_description_service"], "5")))
    assert launch.said == ["no argument fotons: did you mean photons?"]


def test_what_ends_is_started_again_or_ends_the_launch_or_is_the_recorder_and_given_up(launch):
    def ended(name: str, code: int, is_shutdown: bool = False):
        event = SimpleNamespace(returncode=code, process_name=f"{name}-1", action=name)
        return launch.ended(restarts, name, event, SimpleNamespace(is_shutdown=is_shutdown))

    restarts = Restarts(["recorder", "sketcher", "player"])
    assert ended("player", 0) == "the player has ended" and ended("sketcher", 0, is_shutdown=True) is None
    assert [ended("recorder", -9) for _ in range(MOST_RESTARTS + 1)] == [*MOST_RESTARTS * [None], "no more recorder"]
    assert launch.said == ["recorder: given up, nothing is recorded; points go on"]
    for name, code, is_shutdown in (("player", 0, False), ("sketcher", 0, True)):
        with pytest.raises(RuntimeError, match="the recorder was given up: the recording is not complete"):
            ended(name, code, is_shutdown)
    restarts = Restarts(["recorder", "sketcher", "player"])
    for name, code, is_shutdown in (("player", 3, False), ("sketcher", 2, False), ("recorder", 1, True)):
        with pytest.raises(RuntimeError, match=f"{name}-1 has failed with exit code {code}"):
            ended(name, code, is_shutdown)


def test_other_nodes_of_a_launch_inherit_no_variable_from_this_package(repository):
    imports = [ast.unparse(line) for line in ast.parse((repository / "launch" / "srt3d.launch.py").read_text()).body
               if isinstance(line, ast.ImportFrom) and line.module.startswith("srt3d_ros")]
    code = "\n".join(["import os", "before = dict(os.environ)", *imports, "assert os.environ == before"])
    assert imports
    subprocess.run([sys.executable, "-c", code], cwd=repository, env={}, check=True)
