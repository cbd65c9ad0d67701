"""Fuzz targets of what users type: parameter files, arguments of `srt3d`, names of cloud files; and the kernels."""

import contextlib
import importlib
import io
import itertools
import re
import struct
from functools import partial
from pathlib import Path

import numpy as np

from robustness.targets import Defect, Made, Target
from robustness.targets_files import own_folder, photon_file, recording
from srt3d_ros.cli.main import BAD_INPUT, COMMANDS, main, parser
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.errors import InvalidInput
from srt3d_ros.node_names import NODES
from srt3d_ros.recording import cloud_files

RUN = ("reconstruct", "review")         # commands that start no processes, and end
VALUES = ("0", "-1", "1", "2", "3.5", "nan", "inf", "-inf", "1e999", "9" * 400, "", " ", "-", "--", "auto", "cuda",
          "a=b", "1,2", ",", "5,40", "spread", "é", "\udcff", "/", "/dev/null", "x" * 300, "absent.npz", "{}", "[1",
          "a:=1", "sketcher.sketch_size:=5", "sketcher.sketch_size:=[", "photons:=/p", "/x y", "front", "127.0.0.1:1",
          "9:99999")
LITERAL = 250                           # a byte from here on begins a text of its own, which a zero ends
PLY_LINES = 11                          # before end_header
PERIODS = (2, 3, 97, 4613)              # T of the kernels' frames


def _parameters() -> Made:
    """The bytes are a parameter file; the nodes read it in turn."""
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

    short = "".join(f"/**/{name}:\n  ros__parameters:\n    {parameter.name}: {parameter.default!r}\n".replace("'", '"')
                    for name in NODES for parameter in SPECS[name].table[:2])
    return read, [short.encode(), re.sub(r" *#.*\n", "", generated()["config/srt3d.yaml"]).encode()]


def _words() -> list[str]:
    """Commands, options and values, from which command lines are made."""
    words = [*COMMANDS]
    for command in COMMANDS:
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            parser((command,)).parse_args([command, "--help"])
        words += re.findall(r"(?<![\w-])--?[a-z][a-z-]*", text.getvalue())
    return list(dict.fromkeys(words)) + list(VALUES)


def _command_line(run: tuple[str, ...]) -> Made:
    """Each byte is a word of a command line, or begins a text; of commands not in `run` only the arguments are read."""
    folder = own_folder()
    (folder / "a.npz").write_bytes(photon_file())
    (folder / "a.rrd").write_bytes(recording())
    files = photons_npz, recording_rrd, out_ply, here = [
        str(path) for path in (folder / "a.npz", folder / "a.rrd", folder / "out.ply", folder)]
    words = [*_words(), *files]

    def line_of(raw: bytes) -> list[str]:
        out, rest = [], iter(raw)
        for byte in rest:
            if byte < LITERAL:
                out.append(words[byte % len(words)])
            else:
                out.append(bytes(itertools.takewhile(bool, rest)).decode(errors="surrogateescape"))
        return out

    def read(raw: bytes) -> None:
        argv, said = line_of(raw), io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            try:
                code = main(argv) if argv[:1] and argv[0] in run else _parse(argv)
            except SystemExit as exit:
                code = exit.code
        errors = [line for line in said.getvalue().splitlines() if line.startswith("srt3d: error: ")]
        if code not in (0, BAD_INPUT, None) or len(errors) != (code == BAD_INPUT) or "Traceback" in said.getvalue():
            raise Defect(f"command_line: {argv} ends with {code}: {said.getvalue()[-500:]}")
        if code == BAD_INPUT:
            raise InvalidInput("command line", " ".join(argv), "another")

    examples = [["reconstruct", photons_npz, "-o", out_ply, "--sketch-size", "2", "--device", "auto"],
                ["reconstruct", photons_npz, "-o", out_ply, "--gate", "5,40"],
                ["review", recording_rrd, "--no-report"], ["up", "-p", "sketcher.sketch_size:=5"],
                ["evaluate", "--out", here]]
    if run:
        main(examples[0])       # compiles the kernels, once on a machine
    return read, [bytes(words.index(word) for word in argv) for argv in examples]


def _parse(argv: list[str]) -> int:
    """As `main`, but without running; of `up` the arguments for the nodes are made, too."""
    named = tuple(name for name in COMMANDS if name in argv[:1])
    args = parser(named or COMMANDS).parse_args(argv)
    if argv[:1] == ["up"]:
        up = importlib.import_module("srt3d_ros.cli.up")
        specs = up.node_specs(args)
        up.parameters_yaml(args, specs)
        up.ros_arguments(args, specs, __file__)
    return 0


def _cloud_name() -> Made:
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


def _kernels() -> Made:
    """Rows, cols, T, length of the IRF, surfaces; then photons. numba checks bounds: an index outside is an error."""
    def read(raw: bytes) -> None:
        shape, words = raw[:5].ljust(5, b"\1"), np.frombuffer(raw[5:len(raw) - (len(raw) - 5) % 2], np.uint16)
        rows, cols, num_bins = 1 + shape[0] % 40, 1 + shape[1] % 40, PERIODS[shape[2] % len(PERIODS)]
        irf = np.hanning(3 + shape[3] % min(num_bins, 60))[1:-1]
        sensor = SensorModel(rows, cols, num_bins, 1e-10, irf)
        pixel, toa = words[::2] % (rows * cols), words[1::2] % num_bins
        events = PhotonEvents(pixel[:len(toa)].astype(np.uint32), toa.astype(np.uint16))
        frequencies = choose("auto", sensor, min(DEFAULT_SKETCH_SIZE, max((num_bins - 1) // 2, 1)))
        method = METHODS["pooled"].build(sensor, frequencies, surfaces=1 + shape[4] % 2, device="cpu")
        method(sketch_photons(events, sensor, frequencies))

    photons = np.random.default_rng(1).integers(0, 2**16, 800, np.uint16).tobytes()
    return read, [struct.pack("5B", rows, cols, period, length, surfaces) + photons
                  for rows, cols, period, length, surfaces in ((0, 0, 0, 0, 0), (4, 32, 2, 5, 1), (32, 4, 3, 41, 0))]


BOUNDS_CHECKED = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(Path("build/robustness/kernels").absolute())}
TARGETS = (Target("parameters", _parameters, 3_000), Target("arguments", partial(_command_line, ()), 20_000),
           Target("command_line", partial(_command_line, RUN), 1_000, seconds=20.0),
           Target("cloud_name", _cloud_name, 20_000),
           Target("kernels", _kernels, 2_000, seconds=600.0, environment=BOUNDS_CHECKED))
