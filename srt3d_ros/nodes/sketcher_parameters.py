"""The sketcher's public interface, and which of its parameters make a SketchDesign."""

from dataclasses import replace

from srt3d_ros.core.frequencies import DEFAULT_SKETCH_SIZE, RULES
from srt3d_ros.core.gate import FORM, OFF
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.core.window import WINDOW_STAMPS
from srt3d_ros.messages.coded_sketch import DEFAULT_STEP, MAX_STEP, MIN_STEP
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.frame_accounting import PACKETS, PHOTONS
from srt3d_ros.nodes.node_spec import LOSSLESS, NodeSpec, Service
from srt3d_ros.nodes.parameters import Parameter, Value

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
    inputs=(topics.SENSOR, topics.LENS, *topics.FRAMES),
    outputs=(replace(topics.SENSOR, when="`sensor_file` is set"), topics.SKETCH_SENSOR, topics.SKETCH),
    services=(Service("reset", "forget the photons of the open frame and of the window"),),
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
