"""The sketcher's public interface, and what its parameters make."""

from dataclasses import replace

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, RULES
from srt3d_ros.core.gate import FORM, OFF
from srt3d_ros.core.moving_sketcher import MovingSketcher
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.core.sketch_design import SketchDesign
from srt3d_ros.core.window import WindowSketcher
from srt3d_ros.errors import require
from srt3d_ros.messages.coded_sketch import DEFAULT_STEP, MAX_STEP, MIN_STEP
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.motion_input import MOTIONS, parse_extrinsics
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter, Value

AnySketcher = WindowSketcher | MovingSketcher
PARAMETERS = (
    Parameter("sensor_file", "", "Description of the sensor, for a driver that publishes none: JSON as on `sensor`, "
              "or a photon file. If a driver publishes a different description on `sensor`, its photons are dropped "
              "(`contradiction`), and an error in the log and in /diagnostics names the first key that differs.",
              form="a path"),
    Parameter("sketch_size", DEFAULT_SKETCH_SIZE, "Complex numbers per pixel, unless `frequencies` lists them.",
              low=1, high=MAX_SKETCH_SIZE, live=True),
    Parameter("frequencies", "auto", "Frequencies to keep. auto: those with the least expected depth error for the "
              "IRF, the photons per pixel and the SBR; they change at most once in 2 s. spread: geometric, up to "
              "where the IRF passes 0.35. consecutive: 1 to sketch_size, as in the paper. Or a list.",
              form="auto, spread, consecutive or integers such as 1,2,5", live=True),
    Parameter("gate", OFF, "Depth bins to keep. Photons in other bins are dropped (`photons_dropped.gate`), and T "
              "becomes the gate's length: less background and finer depths at a low SBR. auto follows the depths that "
              "stand out in the histogram of all photons, inside and outside the gate. It changes at most once in "
              "2 s, and keeps all bins if little background could be dropped. The spread of the pixels' delays widens "
              "a gate.", form=FORM, live=True, loose=True),
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
    Parameter("coding_step", DEFAULT_STEP, "For coded: rounding step of the sums, in standard deviations of their "
              "photon noise. Rounding adds coding_step² / 12 to the variance. Doubling the step saves two bits per "
              "complex number.", "σ", MIN_STEP, MAX_STEP, live=True),
    Parameter("max_mbit_s", 0.0, "Limit of the mean rate of `sketch`, for a link to another machine. If the link or a "
              "reliable reader is slower, a frame waits, later frames are added to it, and `coding_step` doubles up "
              "to 1.6, until there is room again (WARN in /diagnostics). 0: no limit, every frame is sent as it is. "
              "Not with motion.", "Mbit/s", 0, 100_000, live=True),
    Parameter("frame_id", "", "tf frame of the published messages; if empty, that of the received ones.", live=True),
)

SPEC = NodeSpec(
    "sketcher",
    inputs=(topics.SENSOR, *topics.FRAMES, *topics.MOTION, topics.IMAGES[0]),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    services=("reset",),
    parameters=PARAMETERS,
)


def design_settings(values: dict[str, Value]) -> tuple[str, str, int | None]:
    """What a SketchDesign takes beside the sensor: gate, frequencies and sketch size."""
    spec = values["frequencies"]
    return values["gate"], spec, values["sketch_size"] if spec in RULES else None


def make_sketcher(sensor: SensorModel, design: SketchDesign, values: dict[str, Value]) -> AnySketcher:
    """The sketcher of a design; InvalidInput if its window is too large, or parameters contradict each other."""
    frequencies, frames, still = design.frequencies, values["window_frames"], values["motion"] == OFF
    require(still or not values["max_mbit_s"], "max_mbit_s", values["max_mbit_s"],
            "0 with motion, which has frames seen from different places")
    if still:
        return WindowSketcher(sensor, frequencies, frames, design.gate)
    require(frames == 1, "window_frames", frames, "1 with motion, which has frames seen from different places")
    return MovingSketcher(sensor, frequencies, design.gate)
