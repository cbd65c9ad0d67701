"""bag_recorder: the pipeline's topics → a rosbag2 bag, messages as they came."""

import os
import time
from collections import Counter
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from pathlib import Path

from srt3d_ros.datasets.bag_writer import STORAGES, BagWriter, Offer
from srt3d_ros.errors import require
from srt3d_ros.new_files import free
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode
from srt3d_ros.nodes.lifecycle import PUBLISH_DEPTH
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run
from srt3d_ros.parent import started_again

MB = 10**6
LEAP_NS = 10**9         # messages of several topics fall back in time by less
HOLD_S = 1.0            # how long frames wait for a description
NO_LIMIT = 2**31        # messages that may wait: their bytes are bounded
INPUTS = (topics.SENSOR, topics.SKETCH_SENSOR, *topics.FRAMES, topics.SKETCH, topics.POINTS, *topics.IMAGES,
          topics.CAMERA_INFO, topics.ODOM, topics.IMU)
TOPICS = "photons, gates, histograms, sensor"

PARAMETERS = (
    Parameter("path", "", "Folder of the bag, which must not exist yet; if empty, bag_<UTC time> in the working "
              "directory.", form="a path"),
    Parameter("topics", TOPICS, "Topics of the pipeline to record.", form="names with commas between"),
    Parameter("format", STORAGES[0], "Storage plugin of rosbag2.", choices=STORAGES),
    Parameter("max_duration_s", 0.0, "Finish the bag and exit after this time from its first message; 0: no limit.",
              "s", 0, 10**7),
    Parameter("max_size_mb", 0, "Finish the bag and exit at this size; 0: no limit.", "MB", 0, 10**9),
    Parameter("queue_mb", 512, "Most messages that wait to be written; further ones are dropped.", "MB", 1, 10**6),
    Parameter("min_free_mb", 256, "Finish the bag and exit with an error if the disk has less free space.",
              "MB", 1, 10**9),
)

SPEC = NodeSpec(
    "bag_recorder",
    inputs=tuple(replace(topic, when="if `topics` names it") for topic in INPUTS),
    parameters=PARAMETERS,
)


class BagRecorderNode(PipelineNode):
    """Writes one bag while it is active. The worker's queue is bounded in bytes."""

    spec = SPEC
    drains = True           # what has arrived is written
    finish_s = 120.0        # a slow disk may have queue_mb to write

    def __init__(self):
        super().__init__(NO_LIMIT)
        self._writer: BagWriter | None = None

    def configure(self) -> None:
        known = {topic.name: topic for topic in INPUTS}
        asked = [name.strip() for name in self.parameters["topics"].split(",") if name.strip()]
        for name in asked or [""]:
            require(name in known, "topics", name, f"some of {', '.join(known)}; remap photons to record /spad/raw")
        self._topics = {self.resolve_topic_name(name): topic for name, topic in known.items() if name in asked}

    def activate(self) -> None:
        path = Path(self.parameters["path"] or time.strftime("bag_%Y%m%dT%H%M%SZ", time.gmtime())).absolute()
        if started_again():
            path = free(path)
        self._room_at = next(folder for folder in path.parents if folder.exists())
        require(self._has_room(0), "path", str(path),
                f"a place with more than {self.parameters['min_free_mb']} MB free")
        made: Future[BagWriter] = Future()      # in the worker's thread, which alone may use the writer
        self.worker.call(_make_writer, made, path, self.parameters["format"])
        self._writer = made.result()
        self._lost: Counter[str] = Counter()
        self._ended_by = ""
        self._early: dict[str, bytes] = {}              # by topic: descriptions from before simulated time began
        self._first_ns: int | None = None               # time of the first frame
        self._newest: dict[str, bytes] = {}             # by topic: its description
        self._last_ns = self._greatest_ns = 0           # times of the frames
        self._is_behind = False                         # whether simulated time jumped back
        self._awaited = {name for name, topic in self._topics.items() if topic.latched}
        if self._awaited:
            self.hold_frames_for(f"a description on {self._awaited_names()}")
        for name, topic in self._topics.items():
            self.listen(topic.name, partial(self._received, name), lost=self._count_lost)
        self.diagnostics.show(path=path)

    def stop_frames(self, cause: str) -> None:
        """As in every node, but first take the messages that wait in the middleware."""
        now_ns = time.time_ns()
        for subscription in self.subscriptions_made:
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
        """Complete the bag and log what is in it."""
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
            line += f"; ended {self._ended_by}"
        (self.get_logger().warning if missing else self.get_logger().info)(line)

    def _silent(self, writer: BagWriter) -> list[str]:
        """Topics on which no message came. By default one topic of photons suffices: a driver has one."""
        silent = [name for name in self._topics if name not in writer.messages]
        either = [name for name, topic in self._topics.items() if topic in topics.FRAMES]
        if self.parameters["topics"] == TOPICS and not {*either} <= {*silent}:
            silent = [name for name in silent if name not in either]
        return silent

    def _awaited_names(self) -> str:
        return " and ".join(sorted(self._topics[name].name for name in self._awaited))

    def _count_lost(self, messages: int) -> None:
        super()._count_lost(messages)
        self._lost["on the way"] += messages

    def _received(self, name: str, raw: bytes, info: dict) -> None:
        """In the executor's thread: queue a message, unless simulated time has not begun."""
        received_ns = info["received_timestamp"]
        time_ns = received_ns if received_ns and not self.get_parameter("use_sim_time").value else self.now_ns()
        if not time_ns:
            self._before_time(name, raw)
            return
        early, self._early = self._early, {}
        for described, description in early.items():
            self._queue(described, description, time_ns)
        self._queue(name, raw, time_ns)

    def _before_time(self, name: str, raw: bytes) -> None:
        """Keep a description until simulated time begins; drop a frame: one without a time could not be played."""
        if self._topics[name].latched:
            self._early[name] = raw
            return
        with self.worker.lock:
            self.diagnostics.received()
            self.diagnostics.drop("no_time")
        self.get_logger().warning("frame dropped: use_sim_time is true and nothing came on /clock yet",
                                  throttle_duration_sec=LOG_EVERY_S)

    def _queue(self, name: str, raw: bytes, time_ns: int) -> None:
        """Queue a message, unless the queue is full."""
        if self._topics[name].latched:
            if self._first_ns is not None and name in self._awaited:
                time_ns = min(time_ns, self._first_ns)      # it describes the frames that overtook it
            self._newest[name] = raw
            self.worker.call(self._describe, name, time_ns, raw)
            return
        if self._first_ns is None:
            self._first_ns = time_ns
            self.worker.call_after(HOLD_S, partial(self._end_hold, self._writer))
        if self._leapt(time_ns):
            for described, description in self._newest.items():
                self.worker.call(self._describe, described, time_ns, description)
        with self.worker.lock:
            self.diagnostics.received()
            if self.worker.waiting[1] + len(raw) <= self.parameters["queue_mb"] * MB:
                self.worker.offer(self._write, name, time_ns, raw, size=len(raw))
            else:
                self.diagnostics.drop("queue")
                self._lost["because the queue was full"] += 1

    def _leapt(self, time_ns: int) -> bool:
        """Whether time jumps back, or passes where it jumped. A bag is read in order of time: describe frames again."""
        fell_back = time_ns < self._last_ns - LEAP_NS
        caught_up = self._is_behind and time_ns > self._greatest_ns
        self._is_behind = (self._is_behind or fell_back) and not caught_up
        self._last_ns, self._greatest_ns = time_ns, max(time_ns, self._greatest_ns)
        return fell_back or caught_up

    def _describe(self, name: str, time_ns: int, raw: bytes) -> None:
        self.diagnostics.received()
        self._write(name, time_ns, raw)
        self._awaited.discard(name)
        if not self._awaited:
            self.release_frames()

    def _end_hold(self, writer: BagWriter) -> None:
        """Record frames without their description if it is late, unless their bag is complete."""
        if self._awaited and self._writer is writer:
            self.get_logger().warning(f"no description on {self._awaited_names()} yet: recording without")
            self._awaited.clear()
            self.release_frames()

    def _write(self, name: str, time_ns: int, raw: bytes) -> None:
        """In the worker's thread: write a message, unless the bag has reached a limit, which ends the node."""
        writer = self._writer
        if writer is None or self._ended_by or self._reached_limit(writer, time_ns, len(raw)):
            self.diagnostics.drop("ended")
            return
        try:
            if name not in writer:
                writer.add_topic(name, self._topics[name].type, self._offers(name))
            writer.write(name, time_ns, raw)
        except OSError as error:
            self._writer = None
            self.diagnostics.drop("error")
            self._give_up(writer, error)
            return
        self.sent(time_ns)
        self.diagnostics.show(bag_mb=round(writer.bytes / MB, 1))

    def _offers(self, name: str) -> list[Offer]:
        """The QoS of a topic's publishers: history and depth, which DDS does not announce, are the pipeline's."""
        latched = self._topics[name].latched
        usual = Offer(durability="transient_local" if latched else "volatile", depth=1 if latched else PUBLISH_DEPTH)
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
        return [replace(usual, reliability=qos.reliability.name.lower(), durability=qos.durability.name.lower(),
                        liveliness=qos.liveliness.name.lower(), deadline_ns=qos.deadline.nanoseconds,
                        lifespan_ns=qos.lifespan.nanoseconds,
                        liveliness_lease_ns=qos.liveliness_lease_duration.nanoseconds)
                for qos in profiles] or [usual]

    def _reached_limit(self, writer: BagWriter, time_ns: int, size: int) -> bool:
        """Whether another message would exceed a limit."""
        seconds, megabytes = self.parameters["max_duration_s"], self.parameters["max_size_mb"]
        if writer.bytes and seconds and time_ns - writer.first_ns > seconds * 1e9:
            self._ended_by = "by max_duration_s"
        elif writer.bytes and megabytes and writer.bytes + size > megabytes * MB:
            self._ended_by = "by max_size_mb"
        elif not self._has_room(size):
            self._ended_by = f"with less than {self.parameters['min_free_mb']} MB free on the disk"
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
                "see docs/bags.md for what is left")
        self.get_logger().error(text)
        self.diagnostics.error(text)
        self.exit_code = 1
        self.finished.set()


def _make_writer(future: Future, path: Path, storage: str) -> None:
    try:
        future.set_result(BagWriter(path, storage))
    except Exception as error:
        future.set_exception(error)


main = partial(run, BagRecorderNode)
