"""Fuzz targets of messages, as DDS or a bag hands them to each codec, and of what users type."""

import contextlib
import io
import itertools
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Imu

from robustness.targets import Defect, Made, Target
from srt3d_ros import zstd
from srt3d_ros.cli.main import BAD_INPUT, COMMANDS, parser
from srt3d_ros.cli.up import node_specs, parameters_yaml, ros_arguments
from srt3d_ros.core.histogram_bins import HistogramBins
from srt3d_ros.core.motion import Pose
from srt3d_ros.core.motion_track import MotionTrack
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import (
    camera,
    cdr,
    coded_sketch,
    gates,
    histograms,
    images,
    odometry,
    photons,
    points,
    sensor,
    sketch,
)
from srt3d_ros.node_names import NODES

GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "messages" / "golden"
SENSOR = SensorModel(rows=3, cols=4, num_bins=100, bin_width_s=1e-10, irf=[1, 2, 1], gates=GateWords(10, 65_535),
                     histograms=HistogramBins(5))
FREQUENCIES = (1, 3)        # of the golden sketches
HISTOGRAM_SKETCHER = Sketcher(SENSOR, FREQUENCIES)
SENSOR_TEXTS = [(GOLDEN / f"{name}.json").read_bytes() for name in ("sensor", "sensor_lens", "sensor_histograms",
                                                                       "sensor_scan")]
COMMAND_LINES = ("reconstruct a.npz -o out.ply --sketch-size 2 --device auto", "review a.rrd --no-report --json",
                 "reconstruct a.npz -o out.ply --gate 5:44 --frequencies 1,3 --surfaces 2", "evaluate --out results",
                 "up -p sketcher.sketch_size:=5 -r photons:=/p --config spad_32x32_gates", "play a.npz --rate 2")


def _golden(*names: str) -> list[bytes]:
    return [bytes.fromhex((GOLDEN / f"{name}.hex").read_text()) for name in names]


def _written_again(write, read, raw: bytes):
    """What is read from the bytes. Written and read again it must be the same."""
    frame = read(raw)
    written = write(frame)
    if write(read(written)) != written:
        raise Defect("a frame changes when it is written and read again")
    return frame


def _photons(raw: bytes) -> None:
    _written_again(lambda frame: photons.encode_cdr(frame[1], SENSOR, frame[0].frame_id),
                   lambda raw: photons.decode_cdr(raw, SENSOR), raw)
    cdr.restamp(raw, cdr.stamp_ns(raw))


def _gates(raw: bytes) -> None:
    _, frame = _written_again(lambda frame: gates.encode_cdr(frame[1], SENSOR, frame[0].frame_id),
                              lambda raw: gates.decode_cdr(raw, SENSOR), raw)
    frame.to_events(SENSOR).check(SENSOR)


def _histograms(raw: bytes) -> None:
    _, frame = _written_again(lambda frame: histograms.encode_cdr(frame[1], SENSOR, frame[0].frame_id),
                              lambda raw: histograms.decode_cdr(raw, SENSOR), raw)
    HISTOGRAM_SKETCHER.reset()
    HISTOGRAM_SKETCHER.add(frame)
    if frame.photons < 0:
        raise Defect("a frame has fewer than no photons")


def _sketch(raw: bytes) -> None:
    _, made = sketch.decode_cdr(raw, FREQUENCIES, SENSOR)
    if not (made.photons == sketch.decode_counts_cdr(raw)[1]).all():
        raise Defect("a sketch has other counts when only these are read")


def _coded_sketch() -> Made:
    """The bytes are those of a coded sketch before zstd packs them, whose checksum finds every damage after it."""
    packed = coded_sketch.encode(sketch.decode_cdr(*_golden("sketch_float32"), FREQUENCIES)[1], 0.4)
    at = coded_sketch.HEADER.size + 8 * len(FREQUENCIES)

    def read(raw: bytes) -> None:
        coded_sketch.decode(raw[:at] + zstd.compress(raw[at:], options=coded_sketch.PACKING), FREQUENCIES, (3, 4))

    return read, [packed[:at] + zstd.decompress(packed[at:])]


def _images(raw: bytes) -> None:
    _written_again(lambda frame: images.encode_cdr(frame[1], frame[0].stamp_ns, frame[0].frame_id),
                   images.decode_cdr, raw)


def _sensor(raw: bytes) -> None:
    _written_again(sensor.to_json, sensor.from_json, raw.decode(errors="replace"))


def _sketch_sensor(raw: bytes) -> None:
    sketch.decode_sensor(SimpleNamespace(data=raw.decode(errors="replace")))


def _camera_info() -> Made:
    def read(raw: bytes) -> None:
        try:
            message = deserialize_message(raw, CameraInfo)
        except Exception:       # the middleware refuses it: no node ever sees it
            return
        camera.decode_camera_info(message)

    described = [camera.camera_info(sensor.from_json(text.decode()), 5, "lidar") for text in SENSOR_TEXTS]
    return read, [serialize_message(message) for message in described if message is not None]


def _motion(decode, example) -> Made:
    """What is read is followed, after one that says where the robot was."""
    def read(raw: bytes) -> None:
        report, track = decode(raw), MotionTrack()
        track.add(replace(report, stamp_ns=report.stamp_ns - 10**8, pose=report.pose and Pose()))
        track.add(report)
        pose = track.trajectory.at(report.stamp_ns)
        if not (np.isfinite(pose.rotation).all() and np.isfinite(pose.translation).all()):
            raise Defect("a pose that is not finite")

    return read, [serialize_message(example)]


def _odometry() -> Made:
    example = Odometry(child_frame_id="base_link")
    example.header.frame_id = "odom"
    return _motion(odometry.decode_odometry, example)


def _parameters() -> Made:
    """The bytes are a parameter file; the nodes read it in turn."""
    from rclpy.context import Context
    from rclpy.node import Node

    from srt3d_ros.nodes.parameters import Parameters
    from srt3d_ros.nodes.specs import SPECS
    from tools.generate_docs import generated

    context = Context()         # of its own: whoever else is in this process has the default one
    context.init(args=[])
    names = itertools.cycle(NODES)

    def read(raw: bytes) -> None:
        name = next(names)
        with tempfile.NamedTemporaryFile(suffix=".yaml") as file:
            file.write(raw)
            file.flush()
            try:
                node = Node(name, context=context, start_parameter_services=False, enable_rosout=False,
                            automatically_declare_parameters_from_overrides=True,
                            cli_args=["--ros-args", "--params-file", file.name, "--log-level", "fatal"])
            except RuntimeError as error:               # rcl's parser: the process says so in a line and ends
                raise InvalidInput("command line", "parameters.yaml", f"ROS arguments ({error})") from None
        try:
            Parameters(node, SPECS[name].table)
        finally:
            node.destroy_node()

    every = re.sub(r" *#.*\n", "", generated()["config/srt3d.yaml"])
    return read, [every.encode(), re.sub(r"(?m)(ros__parameters:\n(?:.*\n){2})(?:    .*\n)+", r"\1", every).encode()]


def _arguments(raw: bytes) -> None:
    """The bytes are the words of a command line."""
    argv, said = raw.decode(errors="surrogateescape").split(" "), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            args, code = parser((argv[0],) if argv[0] in COMMANDS else COMMANDS).parse_args(argv), 0
            if argv[0] == "up":
                specs = node_specs(args)
                parameters_yaml(args, specs)
                ros_arguments(args, specs, __file__)
        except SystemExit as exit:
            code = exit.code or 0
    lines = said.getvalue().splitlines()
    if code not in (0, BAD_INPUT) or len(lines) != (code == BAD_INPUT):
        raise Defect(f"arguments: {argv} end with {code}: {said.getvalue()[-500:]}")
    if code == BAD_INPUT:
        raise InvalidInput("command line", " ".join(argv), "another")


def _target(name: str, read, examples: list[bytes], rounds: int) -> Target:
    return Target(name, lambda: (read, examples), rounds)


TARGETS = (
    _target("photons", _photons, _golden(*(f"photons_{toa}{t}" for toa in ("uint16", "uint32", "float32")
                                           for t in ("", "_t"))), 200_000),
    _target("gates", _gates, _golden("gates"), 200_000),
    _target("histograms", _histograms, _golden(*(f"histograms_{kind}5" for kind in ("8UC", "16UC", "32SC", "32FC"))),
            200_000),
    _target("sketch", _sketch, _golden("sketch_float32", "sketch_int16", "sketch_coded"), 150_000),
    Target("coded_sketch", _coded_sketch, 150_000),
    _target("points", points.decode_cdr, _golden("points_xyzi", "points_full", "points_full_t", "points_xyzi_organised",
                                                 "points_full_organised"), 200_000),
    _target("images", _images, _golden("image_32FC1"), 200_000),
    _target("sensor", _sensor, SENSOR_TEXTS, 100_000),
    _target("sketch_sensor", _sketch_sensor, [sketch.encode_sensor(SENSOR, FREQUENCIES, 3).data.encode()], 100_000),
    Target("camera_info", _camera_info, 100_000),
    Target("odometry", _odometry, 200_000),
    Target("imu", lambda: _motion(odometry.decode_imu, Imu()), 200_000),
    Target("parameters", _parameters, 3_000),
    _target("arguments", _arguments, [line.encode() for line in COMMAND_LINES], 20_000),
)
