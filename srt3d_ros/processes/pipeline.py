"""The pipeline that `srt3d up` and the launch file start: its nodes and their parameters. Imports no ROS 2."""

import difflib
from collections.abc import Iterable, Mapping
from os.path import isfile
from pathlib import Path

from srt3d_ros.errors import quoted, require
from srt3d_ros.files import shared_file
from srt3d_ros.processes.node_command import OF_EVERY_NODE, PLAYER, RECORDER

# The nodes, subscribers first, and the option without which one does not run.
NEEDS = {RECORDER: "record", "reconstructor": "", "sketcher": "", PLAYER: "input"}
# The node and the parameter that an option sets.
OPTIONS = {"record": (RECORDER, "path"), "device": ("reconstructor", "device"),
           "sensor_file": ("sketcher", "sensor_file"), "input": (PLAYER, "input")}
LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")


def nodes(options: Mapping[str, str | None]) -> list[str]:
    """Names of the nodes that these options ask for, subscribers first."""
    return [name for name, option in NEEDS.items() if not option or options.get(option)]


def parameters(options: Mapping[str, str | None], settings: Iterable[str]) -> dict[str, dict[str, object]]:
    """The parameters of each node that runs.

    Args:
        options: those of OPTIONS that are given, among others.
        settings: "NODE.PARAMETER:=VALUE"; they win over options, and later ones over earlier ones.

    Raises:
        InvalidInput: a setting has another form, or names an unknown parameter or a node that does not run.
    """
    import yaml  # comes with rclpy

    shipped = yaml.safe_load(Path(config_file("srt3d")).read_text(encoding="utf-8"))
    values: dict[str, dict[str, object]] = {name: {} for name in nodes(options)}
    for option, (name, parameter) in OPTIONS.items():
        if options.get(option):
            values[name][parameter] = options[option]
    if PLAYER in values:
        values[PLAYER]["wait_for"] = " ".join(name for name in reversed(values) if name != PLAYER)
    for setting in settings:
        where, _, text = setting.partition(":=")
        name, _, parameter = where.partition(".")
        if parameter and name in values:
            _check_name(name, parameter, shipped[f"/**/{name}"]["ros__parameters"])
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            value = None
        if isinstance(value, list):         # ROS 2 refuses a list of integers and other numbers
            value = ",".join(map(str, value))
        require(parameter and name in values and isinstance(value, bool | int | float | str), setting,
                problem=f"{setting}: expected NODE.PARAMETER:=VALUE, NODE one of {', '.join(values)}, VALUE as in YAML")
        values[name][parameter] = value
    return values


def _check_name(node: str, parameter: str, known: Iterable[str]) -> None:
    near = difflib.get_close_matches(parameter, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(known)}."
    require(parameter in known or parameter.startswith(OF_EVERY_NODE), parameter,
            problem=f"{node} has no parameter {parameter}: {hint}")


def config_file(config: str) -> str:
    """The path of a parameter file from its path or, for one in the package, its name; InvalidInput if it is none."""
    path = shared_file(f"config/{config}.yaml") or Path(config)
    require(isfile(path), config, problem=f"config {quoted(config)}: no such parameter file, neither here nor in the "
                                          "package")
    return str(path)
