"""`srt3d up`: the whole pipeline by one command; launch/srt3d.launch.py starts the same nodes."""

import argparse
import difflib
import importlib
import json
import re
import sys
import tempfile
from os.path import isfile
from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.cli import health, node
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files import shared_files
from srt3d_ros.processes.node_arguments import namespace_arguments
from srt3d_ros.processes.node_names import PLAYER
from srt3d_ros.processes.supervisor import supervise

# Which parameter of which node an option sets.
OPTIONS = {"sensor_file": ("sketcher", "sensor_file"), "device": ("reconstructor", "device"),
           "input": ("player", "input"), "record": ("recorder", "path")}
OF_EVERY_NODE = ("use_sim_time", "qos_overrides.")
LEVELS = ("debug", "info", "warn", "error", "fatal")
ABOUT = """\
Run sketcher and reconstructor, and what is asked for beside them, as ROS 2
nodes in processes of their own: photons in, point clouds out. A driver
publishes `sensor` and `photons`, `gates` or `histograms`; or --input plays
them. Ctrl-C ends all, the source first and the recorder last. If a node ends,
all end."""
EXAMPLES = """\
examples:
  a moving scene, no sensor needed:
    srt3d up --input simulator --record run.rrd
  a driver of yours:
    srt3d up -r photons:=/spad/raw -r sensor:=/spad/sensor
  a driver that publishes gates and nothing else:
    srt3d up --config spad_32x32_gates --sensor-file my.json
  parameters of the nodes, in a namespace:
    srt3d up --namespace front -p sketcher.sketch_size:=5

-p goes before the other options, they before --config, the last --config before
the others; config/srt3d.yaml lists every parameter. Exit code: 0 after Ctrl-C,
or when a node is done (a player at its end); 3 if frames that a player sent up
to its end were lost; else the failed node's."""


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("up", help="photons in, point clouds out: the pipeline by one command",
                                   description=ABOUT, epilog=EXAMPLES,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--input", metavar="INPUT", help="photon file to play, or: simulator")
    add("--sensor-file", metavar="FILE", help="description of the sensor (.json), if the driver publishes none")
    add("--config", metavar="FILE", action="append", default=[],
        help="parameter file, or the name of one that comes with the package; may be repeated")
    add("--device", metavar="DEVICE", help="where to reconstruct: auto, cpu or cuda")
    add("--record", metavar="FILE", help="recording to write (.rrd)")
    add("--namespace", metavar="NS", help="of all nodes and topics")
    add("-r", dest="remap", metavar="TOPIC:=NAME", action="append", default=[],
        help="another name for a topic; may be repeated")
    add("-p", dest="set", metavar="NODE.PARAMETER:=VALUE", action="append", default=[],
        help="a parameter of a node; may be repeated")
    add("--log-level", choices=LEVELS, help="what the nodes log")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    node.exit_at_once_on_signals()
    specs = node_specs(args)
    with tempfile.NamedTemporaryFile("w", prefix="srt3d_up_", suffix=".yaml") as own:
        own.write(parameters_yaml(args, specs))
        own.flush()
        ros_args = ros_arguments(args, specs, own.name)
        print(overview(args, specs), flush=True)
        names = full_names(args, specs)
        listener = health.Listener() if sys.stdout.isatty() else None
        return supervise([spec.name for spec in specs], ros_args, lambda: listener and listener.print_line(names))


def full_names(args: argparse.Namespace, specs: list) -> list[str]:
    """The nodes' names with the namespace, as frames pass them."""
    return [f"{(args.namespace or '').strip('/')}/{spec.name}".strip("/") for spec in reversed(specs)]


def node_specs(args: argparse.Namespace) -> list:
    """The specs of the nodes asked for, subscribers first; ModuleNotFoundError for what one of them lacks."""
    asked = {"recorder": args.record, "reconstructor": True, "sketcher": True, PLAYER: args.input}
    return [importlib.import_module(f"srt3d_ros.nodes.{name}").SPEC for name, wanted in asked.items() if wanted]


def parameters_yaml(args: argparse.Namespace, specs: list) -> str:
    """A parameter file of the options and of -p: ROS 2's own `-p NODE:NAME:=VALUE` knows no node in a namespace.

    Raises:
        InvalidInput: a -p that is none, or names what these nodes do not have.
    """
    import yaml  # comes with rclpy

    values: dict[str, dict[str, str]] = {spec.name: {} for spec in specs}
    for option, (name, parameter) in OPTIONS.items():
        if getattr(args, option):
            values[name][parameter] = json.dumps(getattr(args, option), ensure_ascii=False)
    if PLAYER in values:
        values[PLAYER]["wait_for"] = json.dumps(" ".join(name for name in reversed(values) if name != PLAYER))
    for setting in args.set:
        where, assigned, value = setting.partition(":=")
        name, _, parameter = where.partition(".")
        require(assigned and parameter and name in values and "\n" not in value, "-p", setting,
                f"NODE.PARAMETER:=VALUE, NODE one of {', '.join(values)}")
        try:        # ROS 2 would name a line of the temporary file
            yaml.safe_load(value)
        except yaml.YAMLError:
            raise InvalidInput("-p", setting, "NODE.PARAMETER:=VALUE, VALUE as in a YAML file") from None
        known = [one.name for spec in specs if spec.name == name for one in spec.table]
        if parameter not in known and not parameter.startswith(OF_EVERY_NODE):
            near = difflib.get_close_matches(parameter, known, n=1) or [f"one of {', '.join(known)}"]
            raise InvalidInput(f"parameter of {name}", parameter, near[0])
        values[name][parameter] = value
    lines = []
    for name, given in values.items():
        if given:
            lines += [f"/**/{name}:", "  ros__parameters:", *(f"    {key}: {value}" for key, value in given.items())]
    return "\n".join(lines or ["/**:", "  ros__parameters: {}"]) + "\n"


def ros_arguments(args: argparse.Namespace, specs: list, own_file: str) -> list[str]:
    """The options as arguments of ROS 2; `own_file` is that of `parameters_yaml`."""
    out = ["--ros-args"]
    for config in args.config:
        path = shared_files.find(f"config/{config}.yaml") or Path(config)
        require(isfile(path), "--config", config, "a parameter file, or the name of one that comes with the package")
        out += ["--params-file", str(path)]
    out += ["--params-file", own_file]
    topics = {topic.name for spec in specs for topic in (*spec.inputs, *spec.outputs)
              if not topic.name.startswith("/")}
    for rule in args.remap:
        topic, assigned, name = rule.partition(":=")
        require(assigned and name, "-r", rule, "TOPIC:=NAME")
        plain = re.fullmatch(r"[a-z]\w*(/\w+)*", topic)        # ROS 2 would not say that nothing has this topic
        require(not plain or topic in topics, "-r", rule, f"TOPIC:=NAME, TOPIC one of {', '.join(sorted(topics))}")
        out += ["-r", rule]
    if args.namespace:
        out += namespace_arguments(args.namespace)
    if args.log_level:
        out += ["--log-level", args.log_level]
    return out


def overview(args: argparse.Namespace, specs: list) -> str:
    """The nodes that are started, and what to do next."""
    nodes = ", ".join(f"/{name}" for name in full_names(args, specs))
    lines = [f"srt3d {__version__}: starts {nodes}; Ctrl-C ends them",
             "  topics    ros2 topic list -t", "  health    srt3d health --watch"]
    if not args.input:
        lines.append("  waiting   for a driver: sensor, then photons, gates or histograms; docs/quickstart.md "
                     "writes one")
    return "\n".join(lines)
