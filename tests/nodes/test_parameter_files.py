"""What of a parameter file is for no node: told where it is a mistake, and not where a robot has one file for many."""

import os
from pathlib import Path

import pytest

from srt3d_ros.node_names import NODES
from srt3d_ros.nodes.parameter_files import given_files, passed_over
from srt3d_ros.nodes.specs import SPECS

ALL = "".join(f"/**/{name}: {{ros__parameters: {{}}}}\n" for name in ("sketcher", "recorder", "bag_recorder"))


def told(tmp_path, text: str, *nodes: str) -> list[str]:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    return [line.removeprefix(f"{path}: ") for line in passed_over(path, nodes)]


@pytest.mark.parametrize("text, nodes", [
    (ALL, ["/sketcher"]),
    (ALL, ["/left/recorder"]),
    (ALL, ["/player"]),
    (ALL, ["/a/left/sketcher", "/recorder"]),
    ("sketcher: {ros__parameters: {}}", ["/sketcher"]),
    ("/left/sketcher: {ros__parameters: {}}", ["/left/sketcher"]),
    ("left: {sketcher: {ros__parameters: {}}}", ["/left/sketcher"]),
    ("/*/sketcher: {ros__parameters: {}}", ["/left/sketcher"]),
    ("/**: {ros__parameters: {use_sim_time: true}}", ["/sketcher"]),
    ("/sketcher: {ros__parameters: {}}\ncamera: {ros__parameters: {}}", ["/sketcher", "/reconstructor"]),
])
def test_files_with_something_for_a_node_are_as_they_should_be(tmp_path, text, nodes):
    assert told(tmp_path, text, *nodes) == []


@pytest.mark.parametrize("text, nodes, expected", [
    ("sketchr: {ros__parameters: {}}", ["/sketcher"],
     ["parameters of /sketchr are for no node here: did you mean /sketcher?"]),
    ("/sketcher: {ros__parameters: {}}\n/left/recoder: {ros__parameters: {}}", ["/sketcher", "/recorder"],
     ["parameters of /left/recoder are for no node here: did you mean /recorder?"]),
    ("sketcher: {ros__parameters: {}}", ["/left/sketcher"],
     ["parameters of /sketcher are for no node here: did you mean /left/sketcher?"]),
    ("/*/sketcher: {ros__parameters: {}}", ["/sketcher"],
     ["parameters of /*/sketcher are for no node here: did you mean /sketcher?"]),
    ("camera: {ros__parameters: {}}\nlidar: {ros__parameters: {}}", ["/sketcher", "/recorder"],
     ["no parameters for /sketcher or /recorder: expected a section of this name, found /camera, /lidar"]),
    ("{}", ["/sketcher"], ["no parameters for /sketcher: expected a section of this name, found none"]),
])
def test_a_section_that_reaches_nobody_is_told(tmp_path, text, nodes, expected):
    assert told(tmp_path, text, *nodes) == expected


@pytest.mark.parametrize("text", ["[1, 2]", "a: [", "\0", "1: {2: {ros__parameters: {}}}", "{a: " * 5000])
def test_any_other_file_is_rcls_to_refuse(tmp_path, text):
    assert len(told(tmp_path, text, "/sketcher")) <= 1
    assert passed_over(tmp_path / "absent.yaml", ["/sketcher"]) == []


def test_a_pipe_is_not_read_a_second_time(tmp_path):
    os.mkfifo(tmp_path / "a.yaml")
    assert passed_over(tmp_path / "a.yaml", ["/sketcher"]) == []


def test_all_of_our_nodes_are_known():
    assert set(NODES) == set(SPECS)


def test_files_are_found_among_arguments():
    arguments = ["sketcher", "--ros-args", "--params-file", "a.yaml", "-p", "a:=1", "--params-file", "b.yaml"]
    assert given_files(arguments) == [Path("a.yaml"), Path("b.yaml")]


def test_a_node_says_so_and_goes_on(graph, tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("sketchr: {ros__parameters: {sketch_size: 7}}")
    node = graph.start("sketcher", "--params-file", str(path)).ready()
    assert f"{path}: parameters of /sketchr are for no node here: did you mean {graph.namespace}/sketcher?" in node.text
