"""`srt3d up`: run the whole pipeline; launch/srt3d.launch.py starts the same nodes."""

import argparse
import importlib
import re
import tempfile
from os.path import isfile
from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.cli import node
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.files import shared_file
from srt3d_ros.kernels.devices import DEVICES
from srt3d_ros.processes.node_command import PLAYER, check_parameter, namespace_arguments
from srt3d_ros.processes.supervisor import supervise

# The node and the parameter that an option sets.
NODE_OPTIONS = {"sensor_file": ("sketcher", "sensor_file"), "device": ("reconstructor", "device"),
                "input": ("player", "input"), "record": ("recorder", "path")}
LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
ABOUT = """\
Run the sketcher and the reconstructor, each as a process; --input adds the
player, --record the recorder. Without --input, photons come from your driver.
Ctrl-C stops the nodes in order. A node that dies is started again, at most 5
times in a minute (the player: 5 times in all); then all end, but points go on
without a recorder."""
EXAMPLES = """\
examples:
  a moving scene, no sensor needed:
    srt3d up --input simulator --record run.rrd
  your own driver:
    srt3d up -r photons:=/spad/raw -r sensor:=/spad/sensor
  parameters of a driver's frames, and of a node:
    srt3d up --config spad_32x32_gates -p sketcher.sketch_size:=5

precedence: -p, other options, --config (later files win). config/srt3d.yaml
lists every parameter. Exit code: 0 after Ctrl-C or at the player's end, 3 if
frames of the player were lost, otherwise that of the node that failed."""


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("up", description=ABOUT, epilog=EXAMPLES,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--input", metavar="INPUT", help="photon file to play, or: simulator")
    add("--sensor-file", metavar="FILE", help="sensor description (.json), if the driver publishes none")
    add("--config", metavar="FILE", action="append", default=[],
        help="parameter file, or the name of one in the package; may be repeated")
    add("--device", choices=DEVICES, help="where to reconstruct")
    add("--record", metavar="FILE", help="recording to write (.rrd)")
    add("--namespace", metavar="NS", help="namespace of all nodes and topics")
    add("-r", dest="remap", metavar="TOPIC:=NAME", action="append", default=[],
        help="rename a topic; may be repeated")
    add("-p", dest="set", metavar="NODE.PARAMETER:=VALUE", action="append", default=[],
        help="set a parameter of a node; may be repeated")
    add("--log-level", choices=LOG_LEVELS, help="lowest level that the nodes log")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    node.exit_at_once_on_signals()
    specs = node_specs(args)
    with tempfile.NamedTemporaryFile("w", prefix="srt3d_up_", suffix=".yaml") as own:
        own.write(parameters_yaml(args, specs))
        own.flush()
        ros_args = ros_arguments(args, specs, own.name)
        print(overview(args, specs), flush=True)
        return supervise([spec.name for spec in specs], ros_args)


def node_specs(args: argparse.Namespace) -> list:
    """The specs of the nodes to run, subscribers first; ModuleNotFoundError if a node's packages are missing."""
    asked = {"recorder": args.record, "reconstructor": True, "sketcher": True, PLAYER: args.input}
    return [importlib.import_module(f"srt3d_ros.nodes.{name}").SPEC for name, wanted in asked.items() if wanted]


def parameters_yaml(args: argparse.Namespace, specs: list) -> str:
    """A parameter file with the options and -p, since ROS 2's `-p NODE:NAME:=VALUE` finds no node in a namespace.

    Raises:
        InvalidInput: a -p has another form, names an unknown node or parameter, or has a value that it cannot have.
    """
    import yaml  # comes with rclpy

    values: dict[str, dict[str, object]] = {spec.name: {} for spec in specs}
    tables = {spec.name: {parameter.name: parameter for parameter in spec.table} for spec in specs}
    for option, (name, parameter) in NODE_OPTIONS.items():
        if getattr(args, option):
            values[name][parameter] = getattr(args, option)
    if PLAYER in values:
        values[PLAYER]["wait_for"] = " ".join(name for name in reversed(values) if name != PLAYER)
    for setting in args.set:
        where, assigned, text = setting.partition(":=")
        name, _, parameter = where.partition(".")
        require(assigned and parameter and name in values, "-p", setting,
                f"NODE.PARAMETER:=VALUE, NODE one of {', '.join(values)}")
        check_parameter(name, parameter, tables[name])
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            raise InvalidInput("-p", setting, "NODE.PARAMETER:=VALUE, VALUE as in a YAML file") from None
        if parameter in tables[name]:
            try:
                value = tables[name][parameter].check(value)
            except InvalidInput as error:
                raise InvalidInput(f"-p {where}", error.value, error.expected, error.problem) from None
        values[name][parameter] = value
    nodes = {f"/**/{name}": {"ros__parameters": given} for name, given in values.items() if given}
    return yaml.safe_dump(nodes or {"/**": {"ros__parameters": {}}}, allow_unicode=True)


def ros_arguments(args: argparse.Namespace, specs: list, own_file: str) -> list[str]:
    """The options as arguments for ROS 2; `own_file`: the path of the file from `parameters_yaml`."""
    out = ["--ros-args"]
    for config in args.config:
        path = shared_file(f"config/{config}.yaml") or Path(config)
        require(isfile(path), "--config", config, "a parameter file, or the name of one in the package")
        out += ["--params-file", str(path)]
    out += ["--params-file", own_file]
    topics = {topic.name for spec in specs for topic in (*spec.inputs, *spec.outputs)
              if not topic.name.startswith("/")}
    for rule in args.remap:
        topic, assigned, name = rule.partition(":=")
        require(assigned and name, "-r", rule, "TOPIC:=NAME")
        plain = re.fullmatch(r"[a-z]\w*(/\w+)*", topic)        # ROS 2 ignores a rule for an unknown topic
        require(not plain or topic in topics, "-r", rule, f"TOPIC:=NAME, TOPIC one of {', '.join(sorted(topics))}")
        out += ["-r", rule]
    if args.namespace:
        out += namespace_arguments(args.namespace)
    if args.log_level:
        out += ["--log-level", args.log_level]
    return out


def overview(args: argparse.Namespace, specs: list) -> str:
    """What `srt3d up` prints: the nodes that it starts, and useful commands."""
    namespace = f"/{(args.namespace or '').strip('/')}".rstrip("/")
    nodes = ", ".join(f"{namespace}/{spec.name}" for spec in reversed(specs))
    lines = [f"srt3d {__version__}: starts {nodes}; Ctrl-C stops them",
             "  topics    ros2 topic list -t", "  health    srt3d health --watch"]
    if not args.input:
        lines.append("  waiting   for a driver: sensor, then photons, gates or histograms (docs/quickstart.md)")
    return "\n".join(lines)
