"""Names, exit codes and command lines of the nodes, without importing ROS 2."""

import difflib
import json
import re
import sys
from collections.abc import Collection

from srt3d_ros.errors import require

RECORDER, PLAYER = "recorder", "player"
NODES = ("sketcher", "reconstructor", RECORDER, PLAYER)
FRAMES_LOST = 3     # exit code of a player if some of its frames did not become clouds

# Parameters that ROS 2 gives every node, or how they begin.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def parameter_arguments(parameters: dict[str, object]) -> list[str]:
    """The command-line arguments that set parameters of a node. ROS 2 reads values as YAML, which includes JSON."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False, default=str)}"]
    return arguments


def check_parameter(node: str, parameter: str, known: Collection[str]) -> None:
    """Raise InvalidInput if a node has no such parameter, neither among `known` nor from ROS 2."""
    near = difflib.get_close_matches(parameter, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(known)}."
    require(parameter in known or parameter.startswith(OF_EVERY_NODE), parameter,
            problem=f"{node} has no parameter {parameter}: {hint}")


def node_command(name: str, *ros_args: str, **parameters: object) -> list[str]:
    """The command that runs a node with these parameters and further arguments for ROS 2."""
    # Without -P, Python in a clone imports the clone's srt3d_ros instead of the installed and compiled one.
    return [sys.executable, "-P", "-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters), *ros_args]


def namespace_arguments(namespace: str) -> list[str]:
    """The arguments after `--ros-args` that set a namespace; InvalidInput if the name is not allowed."""
    plain = namespace.strip("/")
    require(re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", plain, re.ASCII), "--namespace", namespace,
            "names of letters, digits and _, joined by /")
    return ["-r", f"__ns:=/{plain}"]
