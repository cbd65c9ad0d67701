"""bag_recorder: the pipeline's topics → a rosbag2 bag, messages as they came."""

import os
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from srt3d_ros.datasets.bags.writer import BagWriter, Offer
from srt3d_ros.errors import require
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.lifecycle import PUBLISH_DEPTH
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.runtime import run

MB = 10**6
QUEUE_MB = 512          # of messages wait for the disk: three seconds of the fastest sensors
FREE_MB = 256           # of the disk are left to the system and to the bag's index
NO_LIMIT = 2**31        # messages that may wait: their bytes are bounded
INPUTS = (topics.SENSOR, topics.SKETCH_SENSOR, *topics.FRAMES, topics.SKETCH, topics.POINTS, *topics.IMAGES,
          topics.CAMERA_INFO, topics.ODOM, topics.IMU)
TOPICS = "photons, gates, histograms, sensor"

SPEC = NodeSpec("bag_recorder", inputs=tuple(replace(one, when="if `topics` names it") for one in INPUTS), parameters=(
    Parameter("path", "", "Folder of the bag, which must not exist yet; if empty, bag_<UTC time> in the working "
              "directory.", form="a path"),
    Parameter("topics", TOPICS, "Topics of the pipeline to record.", form="names with commas between"),
))


class BagRecorderNode(PipelineNode):
    """Writes one bag while it is active. The worker's queue is bounded in bytes."""

    spec = SPEC
    drains = True           # what has arrived is written
    finish_s = 120.0        # a slow disk may have QUEUE_MB to write

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
        self._room_at = next(folder for folder in path.parents if folder.exists())
        require(self._has_room(0), "path", str(path), f"a place with more than {FREE_MB} MB free")
        self._writer, self._is_full, self._lost = BagWriter(path), False, 0
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
        silent = [name for name, topic in self._topics.items() if topic.latched and name not in writer.messages]
        missing = [f"{self._lost} lost"] * bool(self._lost) + [f"nothing came on {name}" for name in silent]
        line = (f"bag {writer.path}: {writer.duration_s:.1f} s, {counts}, {writer.bytes / MB:.1f} MB, "
                f"{', '.join(missing) or 'nothing lost'}"
                + f"; ended with less than {FREE_MB} MB free on the disk" * self._is_full)
        (self.get_logger().warning if missing else self.get_logger().info)(line)

    def _count_lost(self, messages: int) -> None:
        super()._count_lost(messages)
        self._lost += messages

    def _received(self, name: str, raw: bytes, info: dict) -> None:
        """In the executor's thread: queue a message; one that the queue has no room for is dropped."""
        time_ns = info["received_timestamp"] or time.time_ns()
        self.diagnostics.received()
        if self._topics[name].latched or self.worker.waiting[1] + len(raw) <= QUEUE_MB * MB:
            self.worker.offer(self._write, name, time_ns, raw, size=len(raw))
        else:
            self.diagnostics.drop("queue")
            self._lost += 1

    def _write(self, name: str, time_ns: int, raw: bytes) -> None:
        """In the worker's thread: write a message, unless the disk has no room for it, which ends the node."""
        writer, latched = self._writer, self._topics[name].latched
        if writer is not None and not self._is_full and not self._has_room(len(raw)):
            self._is_full, self.exit_code = True, 1
            self.finished.set()
        if writer is None or self._is_full:
            self.diagnostics.drop("ended")
            return
        try:
            if name not in writer:
                offer = Offer(durability="transient_local", depth=1) if latched else Offer(depth=PUBLISH_DEPTH)
                writer.add_topic(name, self._topics[name].type, [offer])
                if latched and writer.bytes:
                    time_ns = min(time_ns, writer.first_ns)         # it describes the frames that overtook it
            writer.write(name, time_ns, raw)
        except OSError as error:
            self._writer = None
            self.diagnostics.drop("error")
            self._give_up(writer, error)
        else:
            self.sent(time_ns)

    def _has_room(self, size: int) -> bool:
        room = os.statvfs(self._room_at)
        return room.f_bavail * room.f_frsize - size > FREE_MB * MB

    def _give_up(self, writer: BagWriter, error: OSError) -> None:
        writer.abandon()
        text = (f"bag {writer.path} cannot be written ({error.strerror}): it was not completed, "
                "see docs/bags.md for what is left")
        self.get_logger().error(text)
        self.diagnostics.error(text)
        self.exit_code = 1
        self.finished.set()


main = partial(run, BagRecorderNode)
