"""bag_recorder: the pipeline's topics → a rosbag2 bag, messages as they came."""

import shutil
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from srt3d_ros.datasets.bags.writer import BagWriter
from srt3d_ros.errors import require
from srt3d_ros.nodes import topics
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.lifecycle import run
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.topics import NodeSpec

MB = 10**6
QUEUE_MB = 512          # of messages wait for the disk: three seconds of the fastest sensors
FREE_MB = 256           # of the disk are left to the system and to the bag's index
INPUTS = (topics.SENSOR, topics.SKETCH_SENSOR, *topics.FRAMES, topics.SKETCH, topics.POINTS, *topics.IMAGES,
          topics.CAMERA_INFO, topics.ODOM, topics.IMU)

SPEC = NodeSpec("bag_recorder", inputs=tuple(replace(one, when="if `topics` names it") for one in INPUTS), parameters=(
    Parameter("path", "", "Folder of the bag, which must not exist yet; if empty, bag_<UTC time> in the working "
              "directory.", form="a path"),
    Parameter("topics", "photons, gates, histograms, sensor", "Topics to record.", form="names with commas between"),
))


class BagRecorderNode(PipelineNode):
    """Writes one bag while it is active. The worker's queue is bounded in bytes."""

    spec = SPEC
    drains = True           # what has arrived is written
    finish_s = 120.0        # a slow disk may have QUEUE_MB to write

    def __init__(self):
        super().__init__(queue_limit=2**31)      # messages: their bytes are bounded
        self._writer: BagWriter | None = None

    def configure(self) -> None:
        known = {topic.name: topic for topic in INPUTS}
        asked = [name.strip() for name in self.parameters["topics"].split(",") if name.strip()]
        for name in asked or [""]:
            require(name in known, "topics", name, f"some of {', '.join(known)}; remap photons to record /spad/raw")
        self._topics = {self.resolve_topic_name(name): topic for name, topic in known.items() if name in asked}

    def activate(self) -> None:
        path = Path(self.parameters["path"] or time.strftime("bag_%Y%m%dT%H%M%SZ", time.gmtime())).absolute()
        self._writer, self._lost = BagWriter(path), 0
        for name, topic in self._topics.items():
            self.listen(topic.name, partial(self._received, name), lost=self._count_lost)
        self.diagnostics.show(path=path)

    def forget(self) -> None:
        """Complete the bag and log what is in it."""
        writer = self._writer
        if writer is None:
            return
        try:
            writer.close()
        except OSError as error:
            self._give_up(error)
            return
        self._writer = None
        counts = [f"{name} {number}" for name, number in sorted(writer.messages.items())] or ["no messages"]
        missing = [f"{self._lost} lost"] * bool(self._lost) + [
            f"nothing came on {name}" for name, topic in self._topics.items()
            if topic.latched and name not in writer.messages]
        full = [f"ended with less than {FREE_MB} MB free on the disk"] * bool(self.exit_code)
        (self.get_logger().warning if missing else self.get_logger().info)(
            f"bag {writer.path}: {writer.duration_s:.1f} s, "
            + ", ".join([*counts, f"{writer.bytes / MB:.1f} MB", *(missing or ["nothing lost"]), *full]))

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
        if writer is None or shutil.disk_usage(writer.path).free < FREE_MB * MB + len(raw):
            self.diagnostics.drop("disk")
            self.exit_code = 1
            self.finished.set()
            return
        try:
            if name not in writer:
                writer.add_topic(name, self._topics[name].type, latched)
                if latched:         # it describes the frames that overtook it
                    time_ns = min(time_ns, writer.first_ns or time_ns)
            writer.write(name, time_ns, raw)
        except OSError as error:
            self.diagnostics.drop("disk")
            self._give_up(error)
        else:
            self.sent(time_ns)

    def _give_up(self, error: OSError) -> None:
        self._writer.abandon()
        text = f"bag {self._writer.path} cannot be written ({error.strerror}): docs/bags.md says what is left"
        self.get_logger().error(text)
        self.diagnostics.error(text)
        self._writer, self.exit_code = None, 1
        self.finished.set()


main = partial(run, BagRecorderNode)
