"""The sketcher's public interface, and what its parameters make."""

from dataclasses import replace

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, RULES
from srt3d_ros.core.gate import FORM, OFF
from srt3d_ros.core.moving_sketcher import DESKEW_TO, MovingSketcher
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.core.sketch_design import SketchDesign
from srt3d_ros.core.window import WINDOW_STAMPS, WindowSketcher
from srt3d_ros.errors import require
from srt3d_ros.messages.coded_sketch import DEFAULT_STEP, MAX_STEP, MIN_STEP
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.frame_accounting import PACKETS, PHOTONS
from srt3d_ros.nodes.motion_input import MOTIONS, parse_extrinsics
from srt3d_ros.nodes.node_spec import LOSSLESS, NodeSpec
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
    Parameter("silence_s", 0.5, "With frame_period_s: a frame also ends after this time without a packet.", "s", 0.05,
              1000, live=True),
    Parameter("gap_s", 1.0, "Start a new frame and a new window if stamps fall back or leap ahead by more than this, "
              "because the driver, bag or clock restarted. Must exceed the time between packets.",
              "s", 1e-3, 10_000, live=True),
    Parameter("window_frames", 1, "Frames (not messages) in the sliding window of a sketch. With packets_per_frame 2, "
              "a window of 3 frames covers 6 messages.", low=1, high=1000, live=True),
    Parameter("window_stamp", "newest", "Stamp of a window, for tf and for latencies in /diagnostics: start of "
              "acquisition of its newest frame, of its oldest, or half-way between. With newest, tf is right for the "
              "newest photons, and the oldest are off by the sensor's motion since. With middle, both are off by half "
              "of it.", choices=tuple(WINDOW_STAMPS)),
    Parameter("motion", "off", "Source of the sensor's motion. Photons of a frame of several packets are moved to the "
              "sensor's pose at the frame's stamp before they are added. odom: nav_msgs/Odometry. imu: rotation only. "
              "estimate: fit of the photons to the last cloud (`depth`).", choices=MOTIONS, loose=True),
    Parameter("subframes", 10, "With motion: most parts of a frame that are moved separately.", low=1, high=1000),
    Parameter("deskew_to", "middle", "With motion: instant to which the photons of a frame are moved; it is also the "
              "stamp. To the middle, they move by half as much.", choices=DESKEW_TO),
    Parameter("motion_timeout_s", 0.1, "With motion: longest time, in real time, that a complete frame waits for "
              "reports of its motion. After that it is published undeskewed and counted.", "s", 0, 10, live=True),
    Parameter("extrinsics", "", "With motion: pose of the sensor in an Odometry's child_frame_id or an Imu's frame. "
              "If empty, /tf_static gives it. If tf2_msgs is not installed either, the sensor is assumed to coincide "
              "with that frame.", form="x y z qx qy qz qw in metres, or nothing", loose=True, refuse=parse_extrinsics),
    Parameter("layout", "float32", "Layout of `sketch`. int16 halves the bandwidth. coded needs about a tenth: it "
              "rounds to a fraction of the photon noise and compresses.",
              choices=("float32", "int16", "coded"), live=True),
    Parameter("coding_step", DEFAULT_STEP, "For coded: rounding step of the sums, in standard deviations of their "
              "photon noise. Rounding adds coding_step² / 12 to the variance. Doubling the step saves two bits per "
              "complex number.", "σ", MIN_STEP, MAX_STEP, live=True),
    Parameter("max_mbit_s", 0.0, "Limit of the mean rate of `sketch`, for a link to another machine. If the link or a "
              "reliable reader is slower, a frame waits, later frames are added to it, and `coding_step` doubles up "
              "to 1.6, until there is room again (WARN in /diagnostics). 0: no limit, every frame is sent as it is. "
              "Not with motion or lossless.", "Mbit/s", 0, 100_000, live=True),
    Parameter("frame_id", "", "tf frame of the published messages; if empty, that of the received ones.", live=True),
    LOSSLESS,
)

SPEC = NodeSpec(
    "sketcher",
    inputs=(topics.SENSOR, topics.LENS, *topics.FRAMES, *topics.MOTION, topics.IMAGES[0]),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    services=("reset",),
    parameters=PARAMETERS,
    balances=(PACKETS, PHOTONS),
)


def design_settings(values: dict[str, Value]) -> tuple[str, str, int | None]:
    """What a SketchDesign takes beside the sensor: gate, frequencies and sketch size."""
    spec = values["frequencies"]
    return values["gate"], spec, values["sketch_size"] if spec in RULES else None


def make_sketcher(sensor: SensorModel, design: SketchDesign, values: dict[str, Value]) -> AnySketcher:
    """The sketcher of a design; InvalidInput if its window is too large, or parameters contradict each other."""
    frequencies, frames, still = design.frequencies, values["window_frames"], values["motion"] == OFF
    for reason, fits in (("lossless, which sends every frame", not values["lossless"]),
                         ("motion, which has frames seen from different places", still)):
        require(fits or not values["max_mbit_s"], "max_mbit_s", values["max_mbit_s"], f"0 with {reason}")
    if still:
        return WindowSketcher(sensor, frequencies, frames, values["window_stamp"], design.gate)
    return MovingSketcher(sensor, frequencies, frames, values["subframes"], values["deskew_to"], design.gate)
