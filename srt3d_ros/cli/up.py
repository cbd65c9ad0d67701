"""`srt3d up`: run the whole pipeline; launch/srt3d.launch.py starts the same nodes."""

import argparse
import importlib
import re
import tempfile

from srt3d_ros import __version__
from srt3d_ros.cli import node
from srt3d_ros.errors import require
from srt3d_ros.kernels.devices import DEVICES
from srt3d_ros.processes import pipeline
from srt3d_ros.processes.supervisor import supervise

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
    add("--log-level", choices=pipeline.LOG_LEVELS, help="lowest level that the nodes log")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    node.exit_at_once_on_signals()
    for package in ("rclpy", "rerun") if args.record else ("rclpy",):
        importlib.import_module(package)        # one line if it is missing, instead of nodes that fail
    names = pipeline.nodes(vars(args))
    with tempfile.NamedTemporaryFile("w", prefix="srt3d_up_", suffix=".yaml") as own:
        own.write(parameters_yaml(args))
        own.flush()
        ros_args = ros_arguments(args, own.name)
        print(overview(args, names), flush=True)
        return supervise(names, ros_args)


def parameters_yaml(args: argparse.Namespace) -> str:
    """A parameter file with the options and -p, since ROS 2's `-p NODE:NAME:=VALUE` finds no node in a namespace."""
    import yaml  # comes with rclpy

    nodes = {f"/**/{name}": {"ros__parameters": values}
             for name, values in pipeline.parameters(vars(args), args.set).items() if values}
    return yaml.safe_dump(nodes or {"/**": {"ros__parameters": {}}}, allow_unicode=True)


def ros_arguments(args: argparse.Namespace, own_file: str) -> list[str]:
    """The options as arguments for ROS 2; `own_file`: the path of the file from `parameters_yaml`."""
    from srt3d_ros.nodes.common.topics import RELATIVE

    out = ["--ros-args"]
    for path in (*map(pipeline.config_file, args.config), own_file):
        out += ["--params-file", path]
    for rule in args.remap:
        topic, assigned, name = rule.partition(":=")
        require(assigned and name, "-r", rule, "TOPIC:=NAME")
        plain = re.fullmatch(r"[a-z]\w*(/\w+)*", topic)        # ROS 2 ignores a rule for an unknown topic
        require(not plain or topic in RELATIVE, "-r", rule,
                f"TOPIC:=NAME, TOPIC one of {', '.join(sorted(RELATIVE))}")
        out += ["-r", rule]
    if args.namespace:
        namespace = args.namespace.strip("/")
        require(re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", namespace, re.ASCII), "--namespace", args.namespace,
                "names of letters, digits and _, joined by /")
        out += ["-r", f"__ns:=/{namespace}"]
    require(not args.record or args.record.endswith(".rrd"), "--record", args.record, "a path that ends with .rrd")
    if args.log_level:
        out += ["--log-level", args.log_level]
    return out


def overview(args: argparse.Namespace, names: list[str]) -> str:
    """What `srt3d up` prints: the nodes that it starts, and useful commands."""
    namespace = f"/{(args.namespace or '').strip('/')}".rstrip("/")
    nodes = ", ".join(f"{namespace}/{name}" for name in reversed(names))
    lines = [f"srt3d {__version__}: starts {nodes}; Ctrl-C stops them",
             "  topics    ros2 topic list -t", "  health    srt3d health --watch"]
    if not args.input:
        lines.append("  waiting   for a driver: sensor, then photons, gates or histograms (docs/quickstart.md)")
    return "\n".join(lines)
