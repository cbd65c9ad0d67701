"""bag_recorder: the pipeline's topics → a rosbag2 bag, messages as they came."""

import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

from rclpy.clock import Clock, ClockType
from rclpy.qos import HistoryPolicy, QoSProfile

from srt3d_ros.datasets.bag_writer import STORAGES, BagWriter, Offer
from srt3d_ros.errors import require
from srt3d_ros.new_files import free
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import LOG_EVERY_S, PUBLISH_DEPTH, QUEUE_DEPTH, PipelineNode
from srt3d_ros.nodes.node_spec import NodeSpec, Topic
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.parent import started_again

MB = 10**6
LEAP_NS = 10**9         # that time may not fall back by, between messages of several topics
HOLD_S = 1.0            # how long frames wait for the description of what follows, which was latched
TICK_S = 0.1
NO_LIMIT = 2**31        # messages that may wait: it is their bytes that are bounded
DESCRIPTIONS = (topics.SENSOR, topics.SKETCH_SENSOR)
FRAMES = (topics.PHOTONS, topics.GATES, topics.SKETCH, topics.POINTS, *topics.IMAGES, topics.CAMERA_INFO)

TOPICS = "photons, gates, sensor"

PARAMETERS = (
    Parameter("path", "", "The bag, a folder that is not there yet; bag_<UTC time> in the working directory if empty.",
              form="a path"),
    Parameter("topics", TOPICS, "What to record, of the inputs.", form="names with commas between"),
    Parameter("format", STORAGES[0], "How rosbag2 stores it.", choices=STORAGES),
    Parameter("max_duration_s", 0.0, "Finish the bag and exit after this time from its first message; 0: no limit.",
              "s", 0, 10**7),
    Parameter("max_size_mb", 0, "Finish the bag and exit at this size; 0: no limit.", "MB", 0, 10**9),
    Parameter("queue_mb", 512, "Bytes that may wait to be written; what comes when they are full is dropped.", "MB", 1,
              10**6),
    Parameter("min_free_mb", 256, "Finish the bag and exit with an error when less is left on the disk.", "MB", 1,
              10**9),
)

SPEC = NodeSpec(
    "bag_recorder",
    purpose="Records the photons and the description of their sensor, or any other topics of the pipeline, in a bag of "
    "rosbag2: every message as it came, with the time at which it came. `srt3d play`, the player and `ros2 bag play` "
    "play it.",
    inputs=tuple(replace(topic, when="if `topics` names it") for topic in (*DESCRIPTIONS, *FRAMES)),
    parameters=PARAMETERS,
    limits=("It subscribes reliable; for a best-effort publisher override that of the topic.",
            "A description that comes within 1 s after the first frames is recorded at the time of the first.",
            "With `use_sim_time`, frames that come before the first /clock are dropped (`no_time`)."),
)


class BagRecorderNode(PipelineNode):
    """Writes one bag while it is active. The queue to the writer is the worker's, bounded in bytes."""

    spec = SPEC
    drains = True           # what has arrived is written
    finish_s = 120.0        # a slow disk may have queue_mb before it

    def __init__(self):
        super().__init__(NO_LIMIT)
        self._writer: BagWriter | None = None

    def configure(self) -> None:
        """Check what is to be recorded."""
        known = {topic.name: topic for topic in (*DESCRIPTIONS, *FRAMES)}
        asked = [name.strip() for name in self.parameters["topics"].split(",") if name.strip()]
        for name in asked or [""]:
            require(name in known, "topics", name, f"some of {', '.join(known)}; remap photons to record /spad/raw")
        self._topics = [topic for name, topic in known.items() if name in asked]

    def activate(self) -> None:
        """Make the bag and subscribe."""
        path = Path(self.parameters["path"] or time.strftime("bag_%Y%m%dT%H%M%SZ", time.gmtime())).absolute()
        if started_again():
            path = free(path)
        self._room_at = next(folder for folder in path.parents if folder.exists())
        require(self._has_room(0), "path", str(path),
                f"a place with more than {self.parameters['min_free_mb']} MB free")
        made: Future[BagWriter] = Future()
        self.worker.call(_settle, made, lambda: BagWriter(path, self.parameters["format"]))
        self._writer = made.result()
        self._waiting_bytes, self._lost = 0, Counter()
        self._ended_by = ""
        self._early: dict[str, tuple[Topic, str, bytes]] = {}       # descriptions of before simulated time began
        self._first_ns: int | None = None
        self._first_at = 0.0
        self._newest: dict[str, tuple[Topic, str, bytes]] = {}      # description on each topic
        self._last_ns = self._greatest_ns = 0                       # of the frames
        self._is_behind = False                                     # what was before simulated time jumped back
        self._awaited = {topic.name for topic in self._topics if topic.latched}
        self._timer = None
        if self._awaited:
            self.hold_frames_for(f"a description on {' and '.join(sorted(self._awaited))}")
            self._timer = self.create_timer(TICK_S, self._hold_no_longer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for topic in self._topics:
            self._subscribe(topic)
        self.diagnostics.show(path=path)

    def deactivate(self) -> None:
        """Complete the bag; the next activation begins another, at another path."""
        super().deactivate()
        if self._timer is not None:
            self.destroy_timer(self._timer)

    def stop_frames(self, cause: str) -> None:
        """As in every node, but first take what has come and waits in the middleware for the executor."""
        now_ns = time.time_ns()
        for subscription in self._listening:
            received_ns = 0
            while received_ns < now_ns:
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if taken is None:
                    break
                subscription.callback(*taken)
                received_ns = taken[1]["received_timestamp"]
        super().stop_frames(cause)

    def forget(self) -> None:
        """Complete the bag and say what is in it."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.close()
        except OSError as error:
            self._give_up(writer, error)
            return
        counts = ", ".join(f"{name} {number}" for name, number in sorted(writer.messages.items())) or "no messages"
        losses = ", ".join(f"{number} {where}" for where, number in sorted(self._lost.items()) if number)
        silent = self._silent(writer)
        missing = [f"lost: {losses}"] * bool(losses) + [f"no message came on {' and '.join(silent)}"] * bool(silent)
        line = (f"bag {writer.path}: {writer.duration_s:.1f} s, {counts}, {writer.bytes / MB:.1f} MB, "
                f"{'; '.join(missing) or 'nothing lost'}")
        if self._ended_by:
            line += f"; ended as {self._ended_by}"
        (self.get_logger().warning if missing else self.get_logger().info)(line)

    def _silent(self, writer: BagWriter) -> list[str]:
        """Topics on which no message came. Of photons and gates, both asked for by default, a driver sends one."""
        names = {topic.name: self.resolve_topic_name(topic.name) for topic in self._topics}
        silent = [name for name, on in names.items() if on not in writer.messages]
        if self.parameters["topics"] == TOPICS and not {topics.PHOTONS.name, topics.GATES.name} <= {*silent}:
            silent = [name for name in silent if name not in (topics.PHOTONS.name, topics.GATES.name)]
        return [names[name] for name in silent]

    def _subscribe(self, topic: Topic) -> None:
        def received(raw: bytes, info: dict) -> None:
            self._received(topic, subscription.topic_name, raw, info["received_timestamp"])

        subscription = self.listen_counting(topic.name, received, QUEUE_DEPTH, self._count_lost)

    def _count_lost(self, messages: int) -> None:
        self.diagnostics.lost(messages)
        self._lost["on the way"] += messages

    def _received(self, topic: Topic, name: str, raw: bytes, received_ns: int) -> None:
        """In the executor's thread: to the queue, unless its bytes are too many, or nobody has told the time yet."""
        time_ns = received_ns if received_ns and not self.get_parameter("use_sim_time").value else self.now_ns()
        if not time_ns:
            self._before_time(topic, name, raw)
            return
        while self._early:
            self._take(*self._early.pop(next(iter(self._early))), time_ns)
        self._take(topic, name, raw, time_ns)

    def _before_time(self, topic: Topic, name: str, raw: bytes) -> None:
        """No message came on /clock: a description waits for the time, a frame at no time could not be played."""
        if topic.latched:
            self._early[name] = topic, name, raw
            return
        with self.worker.lock:
            self.diagnostics.received()
            self.diagnostics.drop("no_time")
        self.get_logger().warning("frame dropped: use_sim_time is true and nothing came on /clock yet",
                                  throttle_duration_sec=LOG_EVERY_S)

    def _take(self, topic: Topic, name: str, raw: bytes, time_ns: int) -> None:
        if topic.latched:
            if self._first_ns is not None and topic.name in self._awaited:
                time_ns = min(time_ns, self._first_ns)      # it describes the frames that overtook it
            self._newest[name] = topic, name, raw
            self.worker.call(self._describe, topic, name, time_ns, raw)
            return
        if self._first_ns is None:
            self._first_ns, self._first_at = time_ns, time.monotonic()
        if self._leapt(time_ns):
            for described, on, description in self._newest.values():
                self.worker.call(self._describe, described, on, time_ns, description)
        with self.worker.lock:
            self.diagnostics.received()
            if self._waiting_bytes + len(raw) <= self.parameters["queue_mb"] * MB:
                self._waiting_bytes += len(raw)
                self.worker.offer(self._write_queued, topic, name, time_ns, raw)
            else:
                self.diagnostics.drop("queue")
                self._lost["for want of room in the queue"] += 1

    def _leapt(self, time_ns: int) -> bool:
        """Whether frames fall back in time, or get ahead again: a bag is read in its order, not as it was recorded."""
        fell_back = time_ns < self._last_ns - LEAP_NS
        caught_up = self._is_behind and time_ns > self._greatest_ns
        self._is_behind = (self._is_behind or fell_back) and not caught_up
        self._last_ns, self._greatest_ns = time_ns, max(time_ns, self._greatest_ns)
        return fell_back or caught_up

    def _describe(self, topic: Topic, name: str, time_ns: int, raw: bytes) -> None:
        self.diagnostics.received()
        self._write(topic, name, time_ns, raw)
        self._awaited.discard(topic.name)
        if not self._awaited:
            self.release_frames()

    def _hold_no_longer(self) -> None:
        """In the executor's thread: frames that nobody describes are recorded too."""
        if self._awaited and self._first_ns is not None and time.monotonic() - self._first_at >= HOLD_S:
            self.get_logger().warning(f"nobody has described {' and '.join(sorted(self._awaited))}: recording without")
            self._awaited.clear()
            self.release_frames()

    def _write_queued(self, topic: Topic, name: str, time_ns: int, raw: bytes) -> None:
        with self.worker.lock:
            self._waiting_bytes -= len(raw)
        self._write(topic, name, time_ns, raw)

    def _write(self, topic: Topic, name: str, time_ns: int, raw: bytes) -> None:
        """In the worker's thread. A bag that has reached a limit takes nothing more, and the node ends."""
        writer = self._writer
        if writer is None or self._ended_by or self._reached_limit(writer, time_ns, len(raw)):
            self.diagnostics.drop("ended")
            return
        try:
            if name not in writer:
                offers = [_offer(topic, info.qos_profile) for info in self.get_publishers_info_by_topic(name)]
                writer.add_topic(name, topic.type_name, offers or [_usual(topic)])
            writer.write(name, time_ns, raw)
        except OSError as error:
            self._writer = None
            self.diagnostics.drop("error")
            self._give_up(writer, error)
            return
        self.sent(time_ns)
        self.diagnostics.show(bag_mb=round(writer.bytes / MB, 1))

    def _reached_limit(self, writer: BagWriter, time_ns: int, size: int) -> bool:
        seconds, megabytes = self.parameters["max_duration_s"], self.parameters["max_size_mb"]
        if writer.bytes and seconds and time_ns - writer.first_ns > seconds * 1e9:
            self._ended_by = "max_duration_s says"
        elif writer.bytes and megabytes and writer.bytes + size > megabytes * MB:
            self._ended_by = "max_size_mb says"
        elif not self._has_room(size):
            self._ended_by = f"less than {self.parameters['min_free_mb']} MB are free on the disk"
            self.exit_code = 1
        else:
            return False
        self.finished.set()
        return True

    def _has_room(self, size: int) -> bool:
        room = os.statvfs(self._room_at)
        return room.f_bavail * room.f_frsize - size > self.parameters["min_free_mb"] * MB

    def _give_up(self, writer: BagWriter, error: OSError) -> None:
        writer.abandon()
        text = (f"bag {writer.path} cannot be written ({error.strerror}): it was not completed, "
                "docs/bags.md tells what is left")
        self.get_logger().error(text)
        self.diagnostics.error(text)
        self.exit_code = 1
        self.finished.set()


def _settle(future: Future, make: Callable[[], object]) -> None:
    """Make something in this thread for another."""
    try:
        future.set_result(make())
    except Exception as error:
        future.set_exception(error)


def _offer(topic: Topic, qos: QoSProfile) -> Offer:
    """What a publisher offers. Its history and depth do not travel: they are taken to be as the pipeline's."""
    known = qos.history in (HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL)
    return Offer(qos.reliability.name.lower(), qos.durability.name.lower(),
                 qos.history.name.lower() if known else "keep_last",
                 qos.depth if known else 1 if topic.latched else PUBLISH_DEPTH,
                 qos.liveliness.name.lower(), qos.deadline.nanoseconds, qos.lifespan.nanoseconds,
                 qos.liveliness_lease_duration.nanoseconds)


def _usual(topic: Topic) -> Offer:
    """What the pipeline's own publishers offer: the one whose message this is has gone already."""
    return Offer(durability="transient_local" if topic.latched else "volatile",
                 depth=1 if topic.latched else PUBLISH_DEPTH)


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run(BagRecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
