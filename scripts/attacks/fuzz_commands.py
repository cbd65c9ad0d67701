"""The doors of users: parameter files, arguments of `srt3d`, names of cloud files."""

import contextlib
import importlib
import io
import itertools
import re
from functools import partial

import numpy as np
from fuzz_doors import Defect, Door
from fuzz_files import own_folder, photon_file, recording

from srt3d_ros import cloud_files
from srt3d_ros.cli.main import BAD_INPUT, COMMANDS, main, parser
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput

NODES = ("sketcher", "reconstructor", "recorder", "bag_recorder", "player")
RUN = ("reconstruct", "review")         # what does not start processes, and ends
VALUES = ("0", "-1", "1", "2", "3.5", "nan", "inf", "-inf", "1e999", "9" * 400, "", " ", "-", "--", "auto", "cuda",
          "a=b", "1,2", ",", "5,40", "spread", "é", "\udcff", "/", "/dev/null", "x" * 300, "absent.npz", "{}", "[1",
          "a:=1", "sketcher.sketch_size:=5", "sketcher.sketch_size:=[", "photons:=/p", "/x y", "front", "127.0.0.1:1",
          "9:99999")
LITERAL = 250                           # a byte from here on begins a text of its own, which a zero ends


def _parameters():
    """The bytes are a parameter file; each node reads its own."""
    from rclpy.context import Context
    from rclpy.node import Node

    from srt3d_ros.nodes.parameters import Parameters
    from srt3d_ros.nodes.specs import SPECS
    from tools.generate_docs import generated

    context = Context()         # of its own: whoever else is in this process has the default one
    context.init(args=[])
    path = own_folder() / "parameters.yaml"
    names = itertools.cycle(NODES)

    def read(raw: bytes) -> None:
        path.write_bytes(raw)
        name = next(names)
        try:
            node = Node(name, context=context, start_parameter_services=False, enable_rosout=False,
                        automatically_declare_parameters_from_overrides=True,
                        cli_args=["--ros-args", "--params-file", str(path), "--log-level", "fatal"])
        except RuntimeError as error:               # rcl's parser: the process says so in a line and ends
            raise InvalidInput("command line", "parameters.yaml", f"ROS arguments ({error})") from None
        try:
            Parameters(node, SPECS[name].table)
        finally:
            node.destroy_node()

    whole = generated()["config/srt3d.yaml"]
    short = "".join(f"/**/{name}:\n  ros__parameters:\n    {parameter.name}: {parameter.default!r}\n".replace("'", '"')
                    for name in NODES for parameter in SPECS[name].table[:2])
    return read, [short.encode(), re.sub(r" *#.*\n", "", whole).encode()]


def _words() -> list[str]:
    """Commands, options and values, from which command lines are made."""
    words = [*COMMANDS]
    for command in COMMANDS:
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            parser((command,)).parse_args([command, "--help"])
        words += re.findall(r"(?<![\w-])--?[a-z][a-z-]*", text.getvalue())
    return list(dict.fromkeys(words)) + list(VALUES)


def _command_line(run: tuple[str, ...]):
    """Each byte is a word of a command line, or begins a text; of commands not in `run` only the arguments are read."""
    folder = own_folder()
    (folder / "a.npz").write_bytes(photon_file()[2])
    (folder / "a.rrd").write_bytes(recording())
    words = [*_words(), str(folder / "a.npz"), str(folder / "a.rrd"), str(folder / "out.ply"), str(folder)]

    def line_of(raw: bytes) -> list[str]:
        out, rest = [], iter(raw)
        for byte in rest:
            if byte < LITERAL:
                out.append(words[byte % len(words)])
            else:
                out.append(bytes(itertools.takewhile(bool, rest)).decode(errors="surrogateescape"))
        return out

    def read(raw: bytes) -> None:
        argv = line_of(raw)
        said, told = io.StringIO(), io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(told):
            try:
                code = main(argv) if argv[:1] and argv[0] in run else _parsed(argv)
            except SystemExit as exit:
                code = exit.code
        errors = [line for line in said.getvalue().splitlines() if line.startswith("srt3d: error: ")]
        if code not in (0, BAD_INPUT, None) or len(errors) != (code == BAD_INPUT) or "Traceback" in said.getvalue():
            raise Defect(f"command_line: {argv} ends with {code}: {said.getvalue()[-500:]}")
        if code == BAD_INPUT:
            raise InvalidInput("command line", " ".join(argv), "another")

    def bytes_of(*argv: str) -> bytes:
        return bytes(words.index(word) for word in argv)

    photons_npz, recording_rrd, out_ply, here = words[-4:]
    examples = [bytes_of("reconstruct", photons_npz, "-o", out_ply, "--sketch-size", "2", "--device", "auto"),
                bytes_of("reconstruct", photons_npz, "-o", out_ply, "--gate", "5,40"),
                bytes_of("review", recording_rrd, "--no-report"), bytes_of("up", "-p", "sketcher.sketch_size:=5"),
                bytes_of("evaluate", "--out", here)]
    if run:
        main(line_of(examples[0]))      # compiles the kernels, once on a machine
    return read, examples


def _parsed(argv: list[str]) -> int:
    """As `main`, but for running: of `up`, what it makes of its arguments is looked at as well."""
    named = tuple(name for name in COMMANDS if name in argv[:1])
    args = parser(named or COMMANDS).parse_args(argv)
    if argv[:1] == ["up"]:
        up = importlib.import_module("srt3d_ros.cli.up")
        specs = up.node_specs(args)
        up.parameters_yaml(args, specs)
        up.ros_arguments(args, specs, __file__)
    return 0


def _cloud_name():
    """The bytes up to a zero are the name of a cloud file, the rest is the sensor's frame."""
    folder = own_folder()
    one = np.ones(1, np.float32)
    cloud = PointCloud(one.astype(np.uint16), one.astype(np.uint16), one, one, one, np.ones((1, 3), np.float32),
                       one.astype(np.uint8), np.ones((2, 2), np.float32))

    def read(raw: bytes) -> None:
        name, _, frame = raw.partition(b"\0")
        described = SensorModel(2, 2, 50, 1e-10, [1, 2, 1], frame_id=frame.decode(errors="replace"))
        path = folder / name.decode(errors="surrogateescape").replace("/", "_")
        cloud_files.save(cloud, path, frequencies=(1, 2), sensor=described)
        header = path.read_bytes().partition(b"end_header\n")[0]
        if path.suffix.lower() == ".ply" and len(header.splitlines()) != PLY_LINES:
            raise Defect(f"cloud_name: a header of {len(header.splitlines())} lines for the frame {frame!r}")
        path.unlink()

    return read, [b"a.ply\0lidar", b"b.pcd\0lidar", b"c.npz\0lidar"]


PLY_LINES = 11      # before end_header

DOORS = (Door("parameters", _parameters, 3_000), Door("arguments", partial(_command_line, ()), 20_000),
         Door("command_line", partial(_command_line, RUN), 1_000, seconds=20.0),
         Door("cloud_name", _cloud_name, 20_000))
