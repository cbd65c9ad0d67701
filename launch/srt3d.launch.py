"""The whole pipeline: `ros2 launch srt3d_ros srt3d.launch.py --show-args` lists what can be set."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

PACKAGE = "srt3d_ros"
CONFIG = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "srt3d.yaml"])

ARGUMENTS = (
    DeclareLaunchArgument("namespace", default_value="", description="Namespace of all nodes and topics."),
    DeclareLaunchArgument("config", default_value=CONFIG, description="Parameter file for all nodes."),
    DeclareLaunchArgument("photons", default_value="photons", description="Topic of the photons, as events."),
    DeclareLaunchArgument("gates", default_value="gates", description="Topic of the photons, as gates."),
    DeclareLaunchArgument("sensor", default_value="sensor", description="Topic of the sensor's description."),
    DeclareLaunchArgument("device", default_value="auto", description="Where to reconstruct: auto, cpu or cuda."),
    DeclareLaunchArgument("input", default_value="", description="Photon file or simulator to play; empty: a driver "
                          "publishes the photons."),
    DeclareLaunchArgument("record", default_value="", description="Recording (.rrd) to write; empty: none."),
)


def node(executable: str, parameters: dict, only_with: str = "") -> Node:
    """One of the nodes; with `only_with`, only if that argument is not empty."""
    remappings = [(topic, LaunchConfiguration(topic)) for topic in ("photons", "gates", "sensor")]
    values = {key: ParameterValue(LaunchConfiguration(name), value_type=str) for key, name in parameters.items()}
    condition = IfCondition(NotEqualsSubstitution(LaunchConfiguration(only_with), "")) if only_with else None
    return Node(package=PACKAGE, executable=executable, name=executable, output="screen",
                namespace=LaunchConfiguration("namespace"), parameters=[LaunchConfiguration("config"), values],
                remappings=remappings, condition=condition)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs. The player comes last, so that all listen when it starts."""
    return LaunchDescription([
        *ARGUMENTS,
        node("recorder", {"path": "record"}, only_with="record"),
        node("reconstructor", {"device": "device"}),
        node("sketcher", {}),
        node("player", {"input": "input"}, only_with="input"),
    ])
