"""Names, exit codes and command lines of the nodes, without importing ROS 2."""

import json
import sys

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


def command(*arguments: str) -> list[str]:
    """The command that runs `srt3d` with these arguments."""
    # Without -P, Python in a clone imports the clone's srt3d_ros instead of the installed and compiled one.
    return [sys.executable, "-P", "-m", "srt3d_ros.cli.main", *arguments]


def node_command(name: str, *ros_args: str, **parameters: object) -> list[str]:
    """The command that runs a node with these parameters and further arguments for ROS 2."""
    return command("node", name, *parameter_arguments(parameters), *ros_args)
