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
    Parameter("sensor_file", "", "Description of the sensor, for a driver that publishes none: JSON as on `sensor`, or "
              "a photon file. If a driver publishes another description on `sensor`, photons are dropped "
              "(`contradiction`), and log and /diagnostics name the first key that differs, as an error.",
              form="a path"),
    Parameter("sketch_size", DEFAULT_SKETCH_SIZE, "Complex numbers kept for each pixel, unless `frequencies` lists "
              "them.", low=1, high=MAX_SKETCH_SIZE, live=True),
    Parameter("frequencies", "auto", "Which frequencies to keep: those with the least expected depth error for the "
              "IRF, the photons per pixel and the SBR (other ones at most once in 2 s), spread to where the IRF passes "
              "0.35, 1 to sketch_size as in the paper, or these.",
              form="auto, spread, consecutive or integers such as 1,2,5", live=True),
    Parameter("gate", OFF, "Which bins of depth to keep. Photons of others are dropped (`photons_dropped.gate`), and T "
              "becomes the gate's length: less background and finer depths at a low SBR. `auto` follows the depths "
              "that stand out in the histogram of all photons, also outside of the gate; it changes at most once in "
              "2 s, and keeps all bins where little background could be dropped. The spread of the pixels' delays "
              "widens a gate.",
              form=FORM, live=True, loose=True),
    Parameter("packets_per_frame", 1, "Messages in a frame; with frame_period_s, 1 stands for any number.",
              low=1, high=100_000, live=True),
    Parameter("frame_period_s", 0.0, "Frames by stamp: each holds the stamps of one period and ends with the first "
              "packet of a later one, or with packets_per_frame if all come. Where the packets of a frame share its "
              "stamp, anything up to the time between frames. 0: frames by number only.", "s", 0, 1000, live=True),
    Parameter("silence_s", 0.5, "With frame_period_s: a frame also ends after this time without a packet.", "s", 0.05,
              1000, live=True),
    Parameter("gap_s", 1.0, "Begin a new frame and a new window when stamps fall back or leap ahead by more: driver, "
              "bag or clock began again. More than the time between packets.", "s", 1e-3, 10_000, live=True),
    Parameter("window_frames", 1, "Frames, not messages, in the sliding window that a sketch covers. With "
              "packets_per_frame 2, a window of 3 frames covers 6 messages.", low=1, high=1000, live=True),
    Parameter("window_stamp", "newest", "The stamp of a window, for tf and for latencies in /diagnostics: the start of "
              "acquisition of its newest frame, of its oldest, or half-way between. With `newest`, tf is right for "
              "the newest photons, and the oldest are off by the sensor's motion since; with `middle`, both by half of "
              "it.", choices=tuple(WINDOW_STAMPS)),
    Parameter("motion", "off", "What says how the sensor moves, for frames of several packets: their photons are moved "
              "to where the sensor is at the frame's stamp, before they are added up. odom: nav_msgs/Odometry; imu: "
              "rotation only; estimate: the photons themselves, which have to fit the last cloud (`depth`).",
              choices=MOTIONS, loose=True),
    Parameter("subframes", 10, "With motion: most parts of a frame that are moved each on its own.", low=1, high=1000),
    Parameter("deskew_to", "middle", "With motion: the instant of a frame to which its photons are moved, and its "
              "stamp; to the middle, they are moved by half as much.", choices=DESKEW_TO),
    Parameter("motion_timeout_s", 0.1, "With motion: how long a frame that has ended waits, in real time, for reports "
              "of the motion until then; it goes on undeskewed and counted.", "s", 0, 10, live=True),
    Parameter("extrinsics", "", "With motion: where the sensor is in the frame that moves, an Odometry's "
              "child_frame_id or an Imu's frame. If empty, /tf_static says so; where tf2_msgs is not installed, in the "
              "same place, turned alike.", form="x y z qx qy qz qw in metres, or nothing", loose=True,
              refuse=parse_extrinsics),
    Parameter("layout", "float32", "Form of the sketch on the wire; int16 halves the bandwidth, coded takes about a "
              "tenth: it rounds to a share of the photon noise, and packs.", choices=("float32", "int16", "coded"),
              live=True),
    Parameter("coding_step", DEFAULT_STEP, "For coded: sums are rounded to multiples of so many standard deviations of "
              "their photon noise. Rounding adds coding_step² / 12 to its variance; twice the step saves two bits of "
              "each complex number.", "σ", MIN_STEP, MAX_STEP, live=True),
    Parameter("max_mbit_s", 0.0, "What a link to another machine can spare for `sketch`: the mean of what is sent "
              "stays below. Where that or a reliable reader does not keep up, a frame waits, those that come meanwhile "
              "are added to it, and `coding_step` doubles up to 1.6, until there is room again (WARN in /diagnostics). "
              "0: every frame is sent, as it is.", "Mbit/s", 0, 100_000, live=True),
    Parameter("frame_id", "", "tf frame of what is published; the messages' own if empty.", live=True),
    LOSSLESS,
)

SPEC = NodeSpec(
    "sketcher",
    purpose="Keeps, of each pixel's photons, their number and m complex numbers: a sketch. It is as large for a "
    "billion photons as for one, and enough to reconstruct from. Put it beside the sensor, and send sketches on.",
    inputs=(topics.SENSOR, topics.LENS, *topics.FRAMES, *topics.MOTION, topics.IMAGES[0]),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    services={"reset": "forget the photons of the open frame and of the window"},
    parameters=PARAMETERS,
    limits=(
        "`photons`, `gates` and `histograms` of one sensor only; two sensors take two namespaces.",
        "Packets of the open frame may come in any order. Dropped, and counted, are those older than the last frame "
        "(`late`), those that are in the open frame or the one before to the last byte (`duplicate`; not where every "
        "packet is a frame), and those of a frame that never got its number of packets (`incomplete`).",
        "By number, a lost packet moves all later frames by one packet; by stamp, its frame has fewer photons.",
        "Photons are dropped with their whole packet, one by one only by a gate (`photons_dropped.gate`). Those of "
        "`photons` are counted as the message announces them; those of `gates` and `histograms` as they are read: of "
        "those that never were (`queue`, `malformed`, `no_sensor`, `contradiction`, `outdated`, `inactive`, "
        "`shutdown`), the packets are counted and the photons are not known.",
        "With `motion`, frames that wait for it are `under_way`; `frames_deskewed` and `frames_undeskewed` count those "
        "that went on, `frames_with_parallax` those deskewed with the ranges of a `depth` image, and "
        "`photons_dropped.out_of_view` photons that no pixel sees from where they are moved. Reports that cannot be "
        "used are counted (`motion_refused`); after a jump, a gap of 0.5 s or stamps that fall back the trajectory "
        "begins again (`motion_restarts`). `window_stamp` counts without motion only.",
        "With `max_mbit_s`, frames that wait to be sent are `under_way`, and a sketch of several has the first's "
        "stamp. /diagnostics then has `coding_step_now`, `frames_per_sketch` and `sketch_mbit_s`.",
        "Another sensor or gate, other frequencies, and stamps that begin again start a new window.",
    ),
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
