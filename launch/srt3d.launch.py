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
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, Shutdown
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.logging import get_logger
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import Action, LaunchDescription
from srt3d_ros.processes.node_command import check_parameter
from srt3d_ros.processes.supervisor import END, GIVE_UP, RESTART, RESTART_DELAY_S, Restarts

PACKAGE = "srt3d_ros"
TOPICS = ("photons", "gates", "histograms", "sensor", "odom", "imu", "points", "depth", "intensity")
NEAR = 0.75         # likeness of names, above which one is taken for a mistyped other
OF_LAUNCH = {"ros_namespace"}       # set by PushRosNamespace, and near `namespace`
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
    "odom": "Topic of the robot's odometry, with sketcher.motion:=odom; windows follow it, too.",
    "imu": "Topic of the robot's IMU, with sketcher.motion:=imu.",
    "points": "Topic of the clouds.",
    "depth": "Topic of the depth images.",
    "intensity": "Topic of the intensity images.",
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
ONLY_WITH = {"recorder": "record", "player": "input"}


def generate_launch_description() -> LaunchDescription:
    """The description that `ros2 launch` runs."""
    arguments = [DeclareLaunchArgument(name, default_value=CHOICES.get(name, ("",))[0], description=about,
                                       choices=CHOICES.get(name)) for name, about in ARGUMENTS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=pipeline)])


def pipeline(context) -> list[Action]:
    """The nodes that the given arguments ask for."""
    check_names(context.launch_configurations)
    given = {name: value for name in ARGUMENTS if (value := context.launch_configurations[name])}
    files = [ParameterFile(config_file(given["config"]))] if "config" in given else []
    remappings = [(topic, given[topic]) for topic in TOPICS if topic in given]
    switches = {name: given[name] == "true" for name in ("autostart", "use_sim_time") if name in given}
    names = [name for name in NODES if name not in ONLY_WITH or ONLY_WITH[name] in given]
    chain = {"wait_for": " ".join(name for name in reversed(names) if name != "player")}
    on_exit = partial(ended, Restarts(names))
    return [
        Node(package=PACKAGE, executable=name, name=name, namespace=given.get("namespace"), output="screen",
             parameters=[*files, switches | texts(given, parameters) | (chain if name == "player" else {})
                         | own(context.launch_configurations, name)],
             remappings=remappings, ros_arguments=["--log-level", given["log_level"]], sigterm_timeout=END_S,
             respawn=True, respawn_delay=RESTART_DELAY_S, on_exit=partial(on_exit, name))
        for name, parameters in NODES.items() if name in names]


def check_names(configurations: dict[str, str]) -> None:
    """Refuse a NODE.PARAMETER that does not exist; warn of other arguments that look like a mistyped one.

    An including launch file's own arguments are among them, too.
    """
    shipped = yaml.safe_load(Path(config_file("srt3d")).read_text(encoding="utf-8"))
    for name in sorted(configurations.keys() - ARGUMENTS.keys() - OF_LAUNCH):
        node, dot, parameter = name.partition(".")
        if dot and node in NODES:
            check_parameter(node, parameter, shipped[f"/**/{node}"]["ros__parameters"])
        elif near := difflib.get_close_matches(node, NODES if dot else ARGUMENTS, n=1, cutoff=NEAR):
            problem = f"no argument {name}: did you mean {near[0]}{dot}{parameter}?"
            if dot:
                raise RuntimeError(problem)
            get_logger(PACKAGE).warning(problem)


def own(configurations: dict[str, str], node: str) -> dict:
    """The parameters of a node given as NODE.PARAMETER:=VALUE, with values as in YAML."""
    return {name.removeprefix(f"{node}."): yaml.safe_load(value) for name, value in configurations.items()
            if name.startswith(f"{node}.")}


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
