"""player: a photon file, the simulator or a bag → `photons`, `gates`, `histograms` or `sketch`, and their sensor."""

import time
from dataclasses import replace
from functools import partial

from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from srt3d_ros.datasets.motion_profiles import MOTIONS
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import cdr
from srt3d_ros.messages.photon_frames import CODECS
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.answers import MORE_BYTES, Answers
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.moving_source import PACKETS, MovingSource
from srt3d_ros.nodes.node_spec import LOSSLESS, NodeSpec
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.nodes.sources import AHEAD_NS, SIMULATOR, Item, open_source, reports_first
from srt3d_ros.nodes.topics import Topic
from srt3d_ros.nodes.worker import Dropped

ANSWER_TIMEOUT_S = 10.0     # then unanswered messages are given up: the node that had them is gone
SILENCE_S = 0.25            # without an answer: a frame may lack packets; less than after which sketchers end it
OPEN_FRAME_S = 2.0          # for which messages are waited for at the end that may be of a frame which never ends
ACKNOWLEDGE_S = 5.0
CLOCK_PERIOD_S = 0.01

PARAMETERS = (
    Parameter("input", SIMULATOR, "Photon file (docs/photon-file.md), bag (its folder, .mcap or .db3 file), or "
              "the simulator's moving scene.", form="a path or simulator"),
    Parameter("output", "photons", "File and simulator: topic to publish. gates suit small arrays with few photons "
              "per pixel, histograms few bins with many photons.", choices=tuple(CODECS)),
    Parameter("rate_hz", 10.0, "File and simulator: frames per second. 0 with `lossless`: as fast as they are "
              "answered.", "Hz", 0, 10_000),
    Parameter("loop", True, "File: repeat its frame. The simulator never ends; for bags use `bag_loop`."),
    Parameter("frames", 0, "Exit after this number of frames; 0: no limit.", low=0, high=10**9),
    Parameter("duration_s", 0.0, "Exit after this time (bag: recorded time); 0: no limit. Needs a rate.",
              "s", 0, 10**6),
    Parameter("wait_for_subscribers", 1, "Subscribers to wait for before the first frame.", low=0, high=1000),
    LOSSLESS,
    Parameter("in_flight", 4, "With lossless: most messages without an answer on `points`; at least two frames. After "
              f"{SILENCE_S:g} s without an answer more are sent, up to {MORE_BYTES >> 20} MB, for a frame may lack "
              "packets.", low=1, high=1000),
    Parameter("ppp", 15.0, "Simulator: mean photons per pixel and frame.", low=0, high=10**6),
    Parameter("sbr", 1.0, "Simulator: signal-to-background ratio.", low=1e-6, high=10**6),
    Parameter("seed", 0, "Simulator: the same seed gives the same photons.", low=0, high=10**9),
    Parameter("motion", "off", "Simulator: how the sensor moves through a furnished room: like a person, a drone, or a "
              f"robot that turns on the spot. A frame comes in {PACKETS} packets, and `odom` says where its body is.",
              choices=("off", *MOTIONS), loose=True),
    Parameter("odom_noise", 0.0, "Moving simulator: relative error of the velocity that `odom` integrates; 0.05 is "
              "5 %.", low=0, high=1),
    Parameter("odom_jitter_s", 0.0, "Moving simulator: largest error of the stamps of `odom`.", "s", 0, 1),
    Parameter("odom_delay_s", 0.0, "Moving simulator: delay of `odom`.", "s", 0, 10),
    Parameter("num_bins", 0, "File: T, if the file does not have it.", "bins", 0, 65_535),
    Parameter("bin_width_s", 0.0, "File: bin width, if the file does not have it.", "s", 0, 1),
    Parameter("irf", "", "File: path of the IRF (.npy or .npz), if the file has none.", form="a path"),
    Parameter("fov_deg", 0.0, "File: field of view across the larger side, if the file does not have it.",
              "deg", 0, 179),
    Parameter("frame_id", "", "File and simulator: tf frame of the photons; if empty, their own."),
    Parameter("bag_rate", 1.0, "Bag: speed, 1 as recorded, 2 twice as fast. 0 with `lossless`: as fast as frames are "
              "answered.", low=0, high=1000),
    Parameter("bag_loop", False, "Bag: start again at its end."),
    Parameter("bag_start_s", 0.0, "Bag: start this long after its first message.", "s", 0, 10**6),
    Parameter("bag_stamps", "original", "Bag: original keeps the recorded stamps; now stamps as if the photons were "
              "acquired now.", choices=("original", "now")),
    Parameter("bag_photons_topic", "", "Bag: topic of the photons (in any form) or of the sketches; required if there "
              "are several.", form="a topic's full name"),
    Parameter("bag_sensor_topic", "", "Bag: topic that describes the sensor; required if there are several.",
              form="a topic's full name"),
    Parameter("bag_odom_topic", "", "Bag: topic of the Odometry to play on `odom`; required if there are several.",
              form="a topic's full name"),
    Parameter("bag_imu_topic", "", "Bag: topic of the Imu to play on `imu`; required if there are several.",
              form="a topic's full name"),
    Parameter("clock", False, "Bag: publish its time on /clock, 100 times a second, for nodes with `use_sim_time`."),
)

SPEC = NodeSpec(
    "player",
    inputs=(replace(topics.POINTS, when="`lossless`: they answer what was sent"),),
    outputs=(topics.SENSOR,
             *(replace(one, when=f"`output` is {one.name}, or the bag has {one.name}") for one in topics.FRAMES),
             *(replace(topic, when="the bag has sketches and no photons")
               for topic in (topics.SKETCH_SENSOR, topics.SKETCH)),
             replace(topics.ODOM, when="`motion`, or the bag has a topic of its type, beside photons"),
             replace(topics.IMU, when="the bag has a topic of its type, beside photons"),
             replace(topics.TF_STATIC, when="the bag has it, and tf2_msgs is installed"),
             Topic("/clock", "rosgraph_msgs/msg/Clock", "the time of the recording", when="`clock`")),
    parameters=PARAMETERS,
)


class PlayerNode(PipelineNode):
    """Sends messages when they are due, stamped with that time or as they were recorded."""

    spec = SPEC

    def configure(self) -> None:
        moves = self.parameters["motion"] != "off"
        self._source = (MovingSource if moves else open_source)(self.parameters.as_dict())
        self._replays = bool(self._source.start_ns) and self.parameters["bag_stamps"] == "original"
        require(self._replays or not self.parameters["clock"], "clock", True, "false, unless a bag keeps its stamps")
        for note in self._source.notes:
            self.get_logger().info(f"{self.parameters['input']}: {note}")
        self._answers = Answers(self.parameters["in_flight"], self._source.packets)
        # Before the others, for best effort: whoever has the description has found what was advertised before it.
        self._others = {topic: self.advertise(topic) for topic in self._source.others}
        self._sensors: Publisher | None = None
        if self._source.sensor is not None:
            self._sensors = self.advertise(self._source.describes)
        self._publisher = self.advertise(self._source.output)
        self._transforms = self._advertise_transforms()
        self._clock_timer: Timer | None = None
        if self.parameters["clock"]:
            self._clock_publisher = self.advertise("/clock")

    def activate(self) -> None:
        self._recorded = (self._source.start_ns, time.monotonic())
        if self._sensors is not None:
            self._sensors.publish(self._source.sensor)
        for raw in self._source.transforms if self._transforms else ():
            self._transforms.publish(raw)
        if self.lossless:
            self._points = self.listen("points", self._on_answer)
        if self.parameters["clock"]:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._clock_timer = self.create_timer(CLOCK_PERIOD_S, self._publish_clock, clock=steady)
        self.worker.call(self._play)

    def deactivate(self) -> None:
        """Stop playing; the next activation begins at the beginning."""
        super().deactivate()
        if self._clock_timer is not None:
            self.destroy_timer(self._clock_timer)
        self._answers.clear()

    def cleanup(self) -> None:
        super().cleanup()
        self._source.close()

    def _advertise_transforms(self) -> Publisher | None:
        if not self._source.transforms:
            return None
        try:
            return self.advertise("/tf_static", len(self._source.transforms))
        except ModuleNotFoundError:
            self.get_logger().warning("/tf_static in the bag is not played, for tf2_msgs is not installed: "
                                      "a sketcher with motion needs extrinsics")

    def now_ns(self) -> int:
        """The time by the stamps' clock: if they are kept, the recording's, which stops while the player waits."""
        if not self._replays:
            return super().now_ns()
        time_ns, due_at = self._recorded
        return time_ns - round(max(due_at - time.monotonic(), 0) * self._source.rate * 1e9)

    def _publish_clock(self) -> None:
        self._clock_publisher.publish(ClockMessage(clock=Time(nanoseconds=self.now_ns()).to_msg()))

    def _play(self) -> None:
        try:
            self._wait_for_subscribers()
            self._send_all()
            self._wait_for_answers()
            self._wait_until_acknowledged(self._publisher)
        except Exception:
            self.exit_code = 1
            raise
        finally:
            if not self.halted.is_set():        # else the node was only deactivated
                self.finished.set()

    def _wait_for_subscribers(self) -> None:
        wanted, publisher = self.parameters["wait_for_subscribers"], self._publisher
        self.wait_until(lambda: publisher.get_subscription_count() >= wanted,
                        f"{wanted} subscriber{'s' * (wanted > 1)} on {publisher.topic_name}")
        if self.lossless:
            self.wait_until(self._points.get_publisher_count, f"somebody who publishes {self._points.topic_name}")
        if self._sensors is not None:
            self._wait_until_acknowledged(self._sensors)

    def _wait_until_acknowledged(self, publisher: Publisher) -> None:
        self.wait_until(lambda: all_acknowledged(publisher), f"those who read {publisher.topic_name}", ACKNOWLEDGE_S)

    def _send_all(self) -> None:
        sent, total = 0, None if isinstance(self._source, MovingSource) else self.parameters["frames"] or None
        begun = stamp_ns = None
        ahead_s = AHEAD_NS * 1e-9 if self.lossless and self._others else 0.0
        for item in reports_first(self._source) if ahead_s else self._source.items():
            if begun is None:
                begun, self._first_ns = time.monotonic() + ahead_s, super().now_ns() + round(ahead_s * 1e9)
            due_at = begun + item.due_ns * 1e-9
            is_report = item.topic in self._others
            if not (is_report and ahead_s):         # else its time has not come
                self._recorded = item.time_ns, due_at
            if item.topic == self._source.describes:
                self._send_sensor(item, due_at)
                continue
            if is_report:
                if not self._wait_until_due(due_at - ahead_s):
                    return
                self._others[item.topic].publish(_stamped(item, self._stamp(item, None)))
                continue
            self._wait_for_room()
            stamp_ns, before_ns = self._stamp(item, stamp_ns), stamp_ns
            if before_ns is None:
                self.diagnostics.show(first_stamp_ns=stamp_ns)
            elif stamp_ns < before_ns:      # a bag begins again: answers are matched by rising stamps
                self._wait_for_answers()
            data = _stamped(item, stamp_ns)
            if not self._wait_until_due(due_at):
                return
            if self.lossless:
                self._answers.sent(stamp_ns, len(data))
            self.diagnostics.count(frames_in=1)
            try:
                self.publish_frame(self._publisher, data, stamp_ns, frames_sent=1,
                                   **({} if item.photons is None else {"photons_sent": item.photons}))
            except Dropped as stopped:
                self.diagnostics.drop(stopped.cause)
                return
            sent += 1
            if sent == total or self.halted.is_set():
                return

    def _stamp(self, item: Item, before_ns: int | None) -> int:
        """The stamp of a frame that follows one of `before_ns`: as recorded, as due, or now."""
        if self._replays:
            return item.stamp_ns
        if self._source.rate:
            return self._first_ns + item.acquired_ns
        return max((before_ns or 0) + 1, super().now_ns())

    def _send_sensor(self, item: Item, due_at: float) -> None:
        """Publish another description when the frames before it are answered, and wait until it has arrived."""
        self._wait_for_answers()
        if self._wait_until_due(due_at):
            self._sensors.publish(item.raw)
            self._wait_until_acknowledged(self._sensors)

    def _wait_until_due(self, due_at: float) -> bool:
        """Wait; false if the node is stopped meanwhile."""
        return not self.halted.wait(max(due_at - time.monotonic(), 0) if self._source.rate else 0)

    def _on_answer(self, raw: bytes, _: dict) -> None:
        try:
            self._answers.answered(cdr.stamp_ns(raw))
        except InvalidInput as error:
            self.diagnostics.error(f"{self._points.topic_name}: {error}")

    def _wait_for_room(self) -> None:
        """Wait until another frame may be sent, because of answers, or to hear whether any come then."""
        answers, what = self._answers, f"answers on {self._points.topic_name}" if self.lossless else ""
        while not self.wait_until(lambda: answers.has_room, what, SILENCE_S) and not self.halted.is_set():
            answers.silent()
            if answers.silences * SILENCE_S > ANSWER_TIMEOUT_S:
                self._give_up()

    def _wait_for_answers(self) -> None:
        """Wait until all that was sent is answered, but for what may belong to the last frame, or to an open one."""
        answers = self._answers
        while (waiting := len(answers)) >= answers.per_frame and not self.halted.is_set():
            may_be_open = waiting <= answers.unanswerable
            if not self.wait_until(lambda: len(answers) < waiting, f"answers on {self._points.topic_name}",
                                   OPEN_FRAME_S if may_be_open else ANSWER_TIMEOUT_S) and not self.halted.is_set():
                if not may_be_open:
                    self._give_up()
                break
        answers.clear()

    def _give_up(self) -> None:
        self.diagnostics.count(unanswered=len(self._answers))
        self.get_logger().warning(f"{len(self._answers)} messages were never answered on {self._points.topic_name}")
        self._answers.clear()


def _stamped(item: Item, stamp_ns: int) -> bytes:
    """The message with this stamp."""
    return item.raw if stamp_ns == item.stamp_ns else cdr.restamp(item.raw, stamp_ns)


main = partial(run, PlayerNode)
