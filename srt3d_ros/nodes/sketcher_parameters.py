"""The sketcher's public interface."""

from dataclasses import replace

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, RULES
from srt3d_ros.core.gate import OFF
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.core.stream import StreamOptions
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.motion_input import MOTIONS, parse_extrinsics
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter, Value

PARAMETERS = (
    Parameter("sensor_file", "", "Description of the sensor, for a driver that publishes none: JSON as on `sensor`, "
              "or a photon file. If a driver publishes a different description on `sensor`, its photons are dropped "
              "(`contradiction`), and an error in the log and in /diagnostics names the first key that differs.",
              form="a path"),
    Parameter("sketch_size", DEFAULT_SKETCH_SIZE, "Complex numbers per pixel, unless `frequencies` lists them.",
              low=1, high=MAX_SKETCH_SIZE, live=True),
    Parameter("frequencies", "auto", "Frequencies to keep. auto: those with the least expected depth error for "
              "the IRF. spread: geometric, up to where the IRF passes 0.35. consecutive: 1 to sketch_size, as in the "
              "paper. Or a list.", form="auto, spread, consecutive or integers such as 1,2,5", live=True),
    Parameter("gate", OFF, "First and last depth bin to keep. Photons in other bins are dropped "
              "(`photons_dropped.gate`), and T becomes the gate's length: less background and finer depths at a low "
              "SBR. `srt3d info FILE` proposes one. The spread of the pixels' delays widens it.",
              form="off, or first and last bin such as 100:400", live=True, loose=True),
    Parameter("packets_per_frame", 1, "Messages per frame. With frame_period_s, 1 means any number.",
              low=1, high=100_000, live=True),
    Parameter("frame_period_s", 0.0, "Define frames by stamp: a frame contains the stamps of one period. It ends with "
              "the first packet of a later period, or when packets_per_frame have arrived. If the packets of a frame "
              "share one stamp, use any value up to the time between frames. 0: define frames by number only.",
              "s", 0, 1000, live=True),
    Parameter("window_frames", 1, "Frames (not messages) in the sliding window of a sketch. With packets_per_frame 2, "
              "a window of 3 frames covers 6 messages. With motion: 1.", low=1, high=1000, live=True),
    Parameter("motion", "off", "Source of the sensor's motion. Photons of a frame of several packets are moved to the "
              "sensor's pose in the middle of the frame, which becomes the stamp, before they are added. odom: "
              "nav_msgs/Odometry. imu: rotation only.", choices=MOTIONS, loose=True),
    Parameter("extrinsics", "", "With motion: pose of the sensor in an Odometry's child_frame_id or an Imu's frame. "
              "If empty, the sensor is assumed to coincide with that frame.",
              form="x y z qx qy qz qw in metres, or nothing", loose=True, refuse=parse_extrinsics),
    Parameter("layout", "float32", "Layout of `sketch`. int16 halves the bandwidth. coded needs about a tenth: it "
              "rounds to a fraction of the photon noise and compresses.",
              choices=("float32", "int16", "coded"), live=True),
    Parameter("merge_when_busy", False, "While readers have not acknowledged two sketches, for at most 0.4 s, add the "
              "next frame to the one that waits: a slow link then gets fewer sketches, with all photons. Not with "
              "motion or windows of several frames.", live=True),
    Parameter("frame_id", "", "tf frame of the published messages; if empty, that of the received ones.", live=True),
)

SPEC = NodeSpec(
    "sketcher",
    inputs=(topics.SENSOR, *topics.FRAMES, *topics.MOTION),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    services=("reset",),
    parameters=PARAMETERS,
)


def stream_options(values: dict[str, Value]) -> StreamOptions:
    """What a SketchStream takes of the parameters; InvalidInput if they contradict each other."""
    spec = values["frequencies"]
    return StreamOptions(values["gate"], spec, values["sketch_size"] if spec in RULES else None,
                         values["packets_per_frame"], round(values["frame_period_s"] * 1e9), values["window_frames"],
                         values["motion"] != OFF, parse_extrinsics(values["extrinsics"]), values["merge_when_busy"])
