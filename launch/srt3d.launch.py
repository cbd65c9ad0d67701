"""Launches the whole pipeline: `ros2 launch srt3d_ros srt3d.launch.py --show-args` lists the arguments.

An argument that is not given leaves the value to the parameter file, or else to the node's default.
NODE.PARAMETER:=VALUE, such as sketcher.sketch_size:=5, sets any parameter of a node. A node that ends is started again,
at most 5 times; at the end of the player all end. `srt3d up` starts the same nodes without the launch package.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import Action, LaunchDescription
from srt3d_ros.kernels.devices import DEVICES
from srt3d_ros.nodes.common.topics import RELATIVE
from srt3d_ros.processes import pipeline
from srt3d_ros.processes.node_command import PLAYER
from srt3d_ros.processes.supervisor import MOST_RESTARTS, RESTART_DELAY_S

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
    # The last one wins. An including launch file's own arguments are among the given, too.
    settings = [f"{node}.{name}:={given[name]}" for node in names for name in OF_EVERY_NODE if name in given]
    own = tuple(f"{node}." for node in pipeline.NEEDS)
    settings += [f"{name}:={value}" for name, value in given.items() if name.startswith(own)]
    files = [ParameterFile(pipeline.config_file(given["config"]))] if "config" in given else []
    remappings = [(topic, given[topic]) for topic in RELATIVE if topic in given]
    return [
        Node(package="srt3d_ros", executable=name, name=name, namespace=given.get("namespace"), output="screen",
             parameters=[*files, {key: as_given(value) for key, value in values.items()}], remappings=remappings,
             ros_arguments=["--log-level", given.get("log_level", "info")], sigterm_timeout=END_S,
             respawn=name != PLAYER, respawn_delay=RESTART_DELAY_S, respawn_max_retries=MOST_RESTARTS,
             on_exit=Shutdown(reason="the player has ended") if name == PLAYER else None)
        for name, values in pipeline.parameters(given, settings).items()]


def as_given(value: object) -> object:
    """The value for launch, which else reads a text as YAML: a file may be called 1.0."""
    return ParameterValue(value, value_type=str) if isinstance(value, str) else value
