"""Launches the whole pipeline: `ros2 launch srt3d_ros srt3d.launch.py --show-args` lists the arguments.

An argument that is not given leaves the value to the parameter file, or else to the node's default.
NODE.PARAMETER:=VALUE, such as sketcher.sketch_size:=5, sets any parameter of a node. A node that dies is started again,
at most 5 times in a minute (the player, which begins again, 5 times in all); after that all end, except that points go
on without a recorder. The exit code is 1 if a node ends all or fails at its end, the recorder was given up, or the
player reports lost frames, and 0 after the player's last frame.
`srt3d up` starts the same nodes without the launch package.
"""

import difflib
import signal
from functools import partial

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, Shutdown
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.logging import get_logger
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import Action, LaunchDescription
from srt3d_ros.kernels.devices import DEVICES
from srt3d_ros.nodes.common.topics import RELATIVE
from srt3d_ros.processes import pipeline
from srt3d_ros.processes.supervisor import END, GIVE_UP, RESTART, RESTART_DELAY_S, Restarts

PACKAGE = "srt3d_ros"
ASKED = (0, -signal.SIGINT, -signal.SIGTERM)        # exit codes of a node that was asked to end
NEAR = 0.75         # likeness of names, above which one is taken for a mistyped other
END_S = "60"        # time to write a recording after Ctrl-C; the default of launch is 5 s

OF_EVERY_NODE = {
    "autostart": "true: the nodes configure and activate themselves. false: a lifecycle manager does it.",
    "use_sim_time": "true: the nodes use the clock of the topic /clock.",
}
ARGUMENTS = {
    "config": "Parameter file: a path, or the name of one in the package, such as scanner_141x141.",
    "namespace": "Namespace of all nodes and topics.",
    "sensor_file": "Sensor description (.json), if the driver publishes none.",
    "device": "Where to reconstruct.",
    "input": "Photon file to play, or: simulator. Default: a driver publishes the photons.",
    "record": "Recording (.rrd) to write.",
    "log_level": "Lowest level that the nodes log.",
    **OF_EVERY_NODE,
    **{name: f"New name of a topic: {topic.about}." for name, topic in RELATIVE.items()},
}
CHOICES = {"device": ("", *DEVICES), "log_level": ("", *pipeline.LOG_LEVELS),
           **dict.fromkeys(OF_EVERY_NODE, ("", "true", "false"))}


def generate_launch_description() -> LaunchDescription:
    """The description that `ros2 launch` runs."""
    arguments = [DeclareLaunchArgument(name, default_value="", description=about, choices=CHOICES.get(name))
                 for name, about in ARGUMENTS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])


def start(context) -> list[Action]:
    """The nodes that the given arguments ask for."""
    given = {name: value for name, value in context.launch_configurations.items() if value}
    names = pipeline.nodes(given)
    files = [ParameterFile(pipeline.config_file(given["config"]))] if "config" in given else []
    remappings = [(topic, given[topic]) for topic in RELATIVE if topic in given]
    on_exit = partial(ended, Restarts(names))
    return [
        Node(package=PACKAGE, executable=name, name=name, namespace=given.get("namespace"), output="screen",
             parameters=[*files, {key: as_given(value) for key, value in values.items()}], remappings=remappings,
             ros_arguments=["--log-level", given.get("log_level", "info")], sigterm_timeout=END_S,
             respawn=True, respawn_delay=RESTART_DELAY_S, on_exit=partial(on_exit, name))
        for name, values in pipeline.parameters(given, settings(given, names)).items()]


def settings(given: dict[str, str], names: list[str]) -> list[str]:
    """NODE.PARAMETER:=VALUE for the arguments of every node, then as given, since the last one wins.

    Warns of another argument that looks like a mistyped one. An including launch file's own are among them, too.
    """
    found = [f"{node}.{name}:={given[name]}" for node in names for name in OF_EVERY_NODE if name in given]
    for name in sorted(given.keys() - ARGUMENTS.keys() - {"ros_namespace"}):     # set by PushRosNamespace
        node, dot, _ = name.partition(".")
        if dot and difflib.get_close_matches(node, pipeline.NEEDS, cutoff=NEAR):
            found.append(f"{name}:={given[name]}")
        elif near := difflib.get_close_matches(name, ARGUMENTS, n=1, cutoff=NEAR):
            get_logger(PACKAGE).warning(f"no argument {name}: did you mean {near[0]}?")
    return found


def as_given(value: object) -> object:
    """The value for launch, which else reads a text as YAML: a file may be called 1.0."""
    return ParameterValue(value, value_type=str) if isinstance(value, str) else value


def ended(restarts: Restarts, name: str, event, context) -> Action | None:
    """Called when a node has ended; if this returns None, launch starts it again.

    An exception ends the launch with exit code 1, the action Shutdown with 0.
    """
    code, ending = event.returncode, context.is_shutdown
    if ending:
        step = RESTART if code in ASKED else END
    else:
        step = restarts.after(name, code)
    if step == GIVE_UP:
        get_logger(PACKAGE).error(f"{name}: {step}")
        return EmitEvent(event=ShutdownProcess(process_matcher=matches_action(event.action)))
    if restarts.gave_up and (ending or step == END):
        raise RuntimeError("the recorder was given up: the recording is not complete")
    if step == RESTART:
        return None
    if name == "player" and code == 0:
        return Shutdown(reason="the player has ended")
    raise RuntimeError(f"{event.process_name} has failed with exit code {code}")
