"""The launch file starts every node, with parameters and topics that exist.

pip does not install the launch package: what the file takes from it is replaced. tests/test_install.py runs it with it.
"""

import __future__

import ast
import subprocess
import sys
from types import SimpleNamespace

import pytest

from srt3d_ros.nodes import all_specs
from srt3d_ros.processes.supervisor import MOST_RESTARTS, Restarts


@pytest.fixture
def launch(repository) -> SimpleNamespace:
    """What the file defines; `said` gets the lines that it logs."""
    foreign = ("launch", "launch_ros", "ament_index_python")
    own = [line for line in ast.parse((repository / "launch" / "srt3d.launch.py").read_text()).body
           if not isinstance(line, ast.ImportFrom) or line.module.split(".")[0] not in foreign]
    said = []
    names = {"get_package_share_directory": lambda package: repository, "said": said,
             "get_logger": lambda name: SimpleNamespace(warning=said.append, error=said.append),
             "EmitEvent": lambda event: event, "ShutdownProcess": lambda process_matcher: process_matcher,
             "matches_action": lambda action: f"no more {action}", "Shutdown": lambda reason: reason}
    exec(compile(ast.Module(own, []), "launch", "exec", __future__.annotations.compiler_flag), names)
    return SimpleNamespace(**names)


def test_every_node_is_started_with_parameters_and_topics_that_it_has(launch):
    specs = all_specs()
    assert set(launch.NODES) == set(specs)
    for name, parameters in launch.NODES.items():
        assert set(parameters) <= {parameter.name for parameter in specs[name].table}
    named = {*launch.ONLY_WITH.values(), *launch.TOPICS}.union(*(each.values() for each in launch.NODES.values()))
    assert named <= set(launch.ARGUMENTS)
    topics = {topic.name for spec in specs.values() for topic in (*spec.inputs, *spec.outputs)}
    assert {"odom", "imu", "depth", "intensity"} < set(launch.TOPICS) <= topics


def test_a_parameter_that_does_not_exist_is_refused_and_a_mistyped_argument_warned_of(launch):
    for argument, line in (
            ("sketcher.nonsense", "sketcher has no parameter nonsense: it has sensor_file, sketch_size, "),
            ("sketcher.sketchsize", "sketcher has no parameter sketchsize: did you mean sketch_size?"),
            ("sketchr.sketch_size", "no argument sketchr.sketch_size: did you mean sketcher.sketch_size?")):
        with pytest.raises((ValueError, RuntimeError)) as refused:
            launch.check_names({"photons": "", argument: "5"})
        assert str(refused.value).startswith(line) and "\n" not in str(refused.value)
    launch.check_names(dict.fromkeys([      # those of an including file are left alone
        "fotons", "sketcher.sketch_size", "recorder.use_sim_time", "player.qos_overrides./x.publisher.depth", "map",
        "nav2.map", "params_file", "ros_namespace", "sketcher.start_type_description_service"], ""))
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
    code = "import os; before = dict(os.environ); import srt3d_ros.processes.supervisor; assert os.environ == before"
    subprocess.run([sys.executable, "-c", code], cwd=repository, check=True)
