"""The command line of a node, as ROS 2 reads it."""

import json
import re
import sys

from srt3d_ros.errors import require


def parameter_arguments(parameters: dict[str, object]) -> list[str]:
    """Parameters as command-line arguments of a node. Values are YAML there, of which JSON is a part."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False, default=str)}"]
    return arguments


def node_command(name: str, *ros_args: str, **parameters) -> list[str]:
    """The command that runs a node with these parameters, and other arguments of ROS 2."""
    # -P: in a clone, Python would import its srt3d_ros instead of the one that is installed and compiled.
    return [sys.executable, "-P", "-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters), *ros_args]


def namespace_arguments(namespace: str) -> list[str]:
    """A namespace as arguments of ROS 2, after `--ros-args`; InvalidInput if it cannot be one."""
    plain = namespace.strip("/")
    require(re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", plain, re.ASCII), "--namespace", namespace,
            "letters, digits and _, beginning with a letter, with / between")
    return ["-r", f"__ns:=/{plain}"]
