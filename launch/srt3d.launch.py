"""Launches the whole pipeline: `ros2 launch srt3d_ros srt3d.launch.py --show-args` lists the arguments.

An argument that is not given leaves the value to the parameter file, or else to the node's default.
NODE.PARAMETER:=VALUE, such as sketcher.sketch_size:=5, sets any parameter of a node. The exit code is 1 if a node fails
or the player reports lost frames, and 0 after the player's last frame.
`srt3d up` starts the same nodes without the launch package.
"""

import signal
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import Action, LaunchDescription

PACKAGE = "srt3d_ros"
TOPICS = ("photons", "gates", "histograms", "sensor", "points")
BAD_INPUT = 2       # exit code of a node with bad input: a restart would not help
ASKED = (0, -signal.SIGINT, -signal.SIGTERM)        # exit codes of a node that was asked to end
END_S = "60"        # time to write a recording after Ctrl-C; the default of launch is 5 s

ARGUMENTS = {
    "config": "Parameter file: a path, or the name of one in the package, such as scanner_141x141.",
    "namespace": "Namespace of all nodes and topics.",
    "sensor_file": "Sensor description (.json), if the driver publishes none.",
    "photons": "Topic of the photons, as events.",
    "gates": "Topic of the photons, as gates.",
    "histograms": "Topic of the photons, as histograms.",
    "sensor": "Topic of the sensor's description.",
    "points": "Topic of the clouds.",
    "device": "Where to reconstruct.",
    "input": "Photon file to play, or: simulator. Default: a driver publishes the photons.",
    "record": "Recording (.rrd) to write.",
    "autostart": "true: the nodes configure and activate themselves. false: a lifecycle manager does it.",
    "use_sim_time": "Whether the nodes use the clock of the topic /clock.",
    "log_level": "Lowest level that the nodes log.",
}
CHOICES = {"device": ("", "auto", "cpu", "cuda"), "autostart": ("", "true", "false"),
           "use_sim_time": ("", "true", "false"),
           "log_level": ("info", "debug", "warn", "error", "fatal")}       # the first is the default

# The parameters of each node that arguments set. The player comes last: all others then listen when it starts.
NODES = {
    "recorder": {"path": "record"},
    "reconstructor": {"device": "device"},
    "sketcher": {"sensor_file": "sensor_file"},
    "player": {"input": "input"},
}
RESTARTED = ("sketcher", "reconstructor")       # a new process continues where they ended
MOST_RESTARTS = 5
ONLY_WITH = {"recorder": "record", "player": "input"}


def generate_launch_description() -> LaunchDescription:
    """The description that `ros2 launch` runs."""
    arguments = [DeclareLaunchArgument(name, default_value=CHOICES.get(name, ("",))[0], description=about,
                                       choices=CHOICES.get(name)) for name, about in ARGUMENTS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=pipeline)])


def pipeline(context) -> list[Action]:
    """The nodes that the given arguments ask for."""
    given = {name: value for name in ARGUMENTS if (value := context.launch_configurations[name])}
    files = [ParameterFile(config_file(given["config"]))] if "config" in given else []
    remappings = [(topic, given[topic]) for topic in TOPICS if topic in given]
    switches = {name: given[name] == "true" for name in ("autostart", "use_sim_time") if name in given}
    names = [name for name in NODES if name not in ONLY_WITH or ONLY_WITH[name] in given]
    chain = {"wait_for": " ".join(name for name in reversed(names) if name != "player")}
    return [
        Node(package=PACKAGE, executable=name, name=name, namespace=given.get("namespace"), output="screen",
             parameters=[*files, switches | texts(given, parameters) | (chain if name == "player" else {})
                         | own(context.launch_configurations, name)],
             remappings=remappings, ros_arguments=["--log-level", given["log_level"]], sigterm_timeout=END_S,
             respawn=name in RESTARTED, respawn_delay=1.0, respawn_max_retries=MOST_RESTARTS,
             on_exit=Ended(MOST_RESTARTS if name in RESTARTED else 0, name == "player"))
        for name, parameters in NODES.items() if name in names]


def own(configurations: dict[str, str], node: str) -> dict:
    """The parameters of a node given as NODE.PARAMETER:=VALUE, with values as in YAML."""
    return {name.partition(".")[2]: yaml.safe_load(value) for name, value in configurations.items()
            if name.partition(".")[0] == node}


def texts(given: dict[str, str], parameters: dict[str, str]) -> dict[str, ParameterValue]:
    """Parameters that are strings even if they look like numbers: a file may be called 1.0."""
    return {parameter: ParameterValue(given[argument], value_type=str)
            for parameter, argument in parameters.items() if argument in given}


def config_file(config: str) -> str:
    """The path of a parameter file from its path or its name in share/srt3d_ros/config."""
    shipped = Path(get_package_share_directory(PACKAGE), "config", f"{config}.yaml")
    if not shipped.is_file() and not Path(config).is_file():
        raise RuntimeError(f"config \"{config}\": no such parameter file, neither here nor in the package")
    return str(shipped) if shipped.is_file() else config


class Ended:
    """Called when a node has ended: ends the launch if the node failed for good, or if it was the player.

    The player ends when the others have finished its last frame. An exception ends the launch with exit code 1, the
    action Shutdown with 0.
    """

    def __init__(self, restarts: int, is_player: bool):
        self._restarts, self._is_player = restarts, is_player

    def __call__(self, event, context) -> Action | None:
        if event.returncode not in ASKED and (self._restarts == 0 or event.returncode == BAD_INPUT):
            raise RuntimeError(f"{event.process_name} has failed with exit code {event.returncode}")
        self._restarts -= 1
        return Shutdown(reason="the player has ended") if self._is_player else None
