"""Mutated messages, at full speed, into the real nodes: none ends, none hangs, no good frame among them is lost.

    python scripts/attacks/mutate.py [--messages 1000000] [--seed 1] [--out build/attacks/mutate.json]

Sketcher, reconstructor and recorder run as processes of their own. Before the attack, one good frame of each kind
(`photons`, `gates`, `sketch`) becomes a cloud. Then mutations of them, and of `points` and `depth`, are published, with
a good frame after every 40th, and between them mutations of `sensor`, `sketch/sensor` and `sensor/camera_info`, after
which the good descriptions come again. Some mutations are good messages of other content or of another topic: they may
become clouds, and are not counted as good. What must hold:

    ends        no process ends, none writes a traceback, none fails at a message in another way than by refusing it
    hangs       every good frame's cloud comes within --hang-s
    good        every good frame becomes its cloud, bit for bit that of the same frame without the attack
    accounting  of every node: nothing unaccounted for, nothing under way at the end; what was sent has come in
"""

import argparse
import os
import random
import re
import shutil
import sys
import time
from collections import Counter
from pathlib import Path

from mutations import Mutator
from srt3d_ros.cli.processes import join_private_network

from srt3d_ros.nodes import transport  # before rclpy: it prepares the process for big messages

# isort: split
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from result import write_result
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stack import Stack
from std_msgs.msg import String
from tqdm import tqdm

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.messages import cdr, gates, images, photons, sensor, sketch
from srt3d_ros.messages.camera import camera_info

EVERY = 40                  # messages between good frames
OUTSTANDING = 3             # good frames whose clouds may still have to come: bounds what waits in a node
DATA, DESCRIPTIONS = 1000, 20           # mutated messages of either kind in a round
ROOM = 4000                 # messages that a publisher keeps for its readers
S = 1_000_000_000
MUTATED_NS, GOOD_NS, PROBE_NS = 5 * S, 1_700_000_000 * S, 1_600_000_000 * S     # stamps tell frames apart
STAMP = slice(4, 12)
LOST_S = 30.0
DESCRIBED_S = 120.0         # a mutated description may be one that takes long: the sensor is larger then
PROBES = 3                  # clouds in a row that are as they should be
FRAMES = {"photons": PointCloud2, "gates": Image, "sketch": PointCloud2, "points": PointCloud2, "depth": Image}
GOOD = ("photons", "gates", "sketch")
DESCRIBED = {"sensor": String, "sketch/sensor": String, "sensor/camera_info": CameraInfo}
UNEXPECTED = re.compile(r"Traceback|\b[A-Z]\w*(Error|Exception): ")     # as nodes tell what was not refused
NODES = ("sketcher", "reconstructor", "recorder")


def spad() -> tuple[SensorModel, dict[str, bytes], dict[str, bytes]]:
    """A small sensor, its good frames by topic, its descriptions by topic."""
    described = SensorModel(rows=8, cols=8, num_bins=64, bin_width_s=1e-10, irf=np.array([1.0, 3, 6, 3, 1]),
                            gates=GateWords(first_word=7), frame_id="spad")
    generator = np.random.default_rng(0)
    pixel = np.repeat(np.arange(64, dtype=np.uint32), 20)
    toa = np.where(generator.random(len(pixel)) < 0.2, generator.integers(0, 64, len(pixel)),
                   np.clip(np.rint(generator.normal(30, 1, len(pixel))), 0, 63)).astype(np.uint16)
    events = PhotonEvents(pixel, toa, MUTATED_NS)
    frequencies = choose("auto", described, 4)
    image = generator.random((8, 8)).astype(np.float32)
    frames = {"photons": photons.encode_cdr(events, described, "spad"),
              "gates": gates.encode_cdr(PhotonGates.from_events(events, described), described, "spad"),
              "sketch": sketch.encode_cdr(sketch_photons(events, described, frequencies), "spad"),
              "depth": images.encode_cdr(image, MUTATED_NS, "spad")}
    info = camera_info(described, 0, "spad")
    texts = {"sensor": sensor.encode(described), "sketch/sensor": sketch.encode_sensor(described, frequencies, 1)}
    return described, frames, {name: serialize_message(message) for name, message in (
        *texts.items(), ("sensor/camera_info", info))}


class Attack:
    """The attacker's node: publishes, and holds the clouds that come against those that must."""

    def __init__(self, stack: Stack, seed: int, hang_s: float):
        self._stack, self._hang_s = stack, hang_s
        self._node = rclpy.create_node("attacker")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publishers = {topic: self._node.create_publisher(kind, topic, QoSProfile(depth=ROOM))
                            for topic, kind in FRAMES.items()} | {
            topic: self._node.create_publisher(kind, topic, latched) for topic, kind in DESCRIBED.items()}
        self._node.create_subscription(PointCloud2, "points", self._on_cloud, QoSProfile(depth=ROOM), raw=True)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._random = random.Random(seed)
        self.sensor, self.frames, self.descriptions = spad()
        self._expected: dict[str, bytes] = {}
        self._awaited: dict[int, tuple[str, float]] = {}
        self._probed: dict[int, bytes] = {}
        self.sent: Counter[str] = Counter()
        self.mutated: Counter[str] = Counter()
        self.good, self.wrong, self.lost, self.slowest_s, self.described_s = 0, 0, 0, 0.0, 0.0
        self._stamps = 0

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()

    def begin(self, seed: int) -> None:
        """Describe the sensor, and have one cloud of each kind of frame without any attack."""
        self._wait(lambda: all(publisher.get_subscription_count() for publisher in self._publishers.values()), LOST_S)
        self._describe()
        for kind in GOOD:
            self._expected[kind] = self._cloud_of(kind)
        self.frames["points"] = cdr.restamp(self._raw, MUTATED_NS)
        self._mutator = Mutator(seed, [*self.frames.values(), *self.descriptions.values()])

    def frames_round(self, number: int) -> None:
        """So many mutated frames, with good ones among them."""
        for k in range(number):
            topic = self._random.choice(tuple(FRAMES))
            self._publish(topic, self._mutator.bytes_of(self.frames[topic]))
            self.mutated[topic] += 1
            if k % EVERY == 0:
                self._wait_for_clouds(OUTSTANDING - 1)
                self._send_good()
        self._wait_for_clouds(0)

    def descriptions_round(self, number: int) -> None:
        """So many mutated descriptions, and then the good ones again; they are in force when this returns."""
        for _ in range(number):
            topic = self._random.choice(tuple(DESCRIBED))
            raw = self.descriptions[topic]
            if DESCRIBED[topic] is String and self._random.random() < 0.7:
                raw = cdr.write_text(self._mutator.text_of(cdr.read_text(raw)))
            else:
                raw = self._mutator.bytes_of(raw)
            self._publish(topic, raw)
            self.mutated[topic] += 1
            self._executor.spin_once(timeout_sec=0.001)     # time to read some: of a latched topic the newest is kept
        self._describe()
        started, in_a_row = time.monotonic(), 0
        while in_a_row < PROBES:
            in_a_row = in_a_row + 1 if self._cloud_of("photons") == self._expected["photons"] else 0
            if in_a_row == 0:
                self._describe()
            if time.monotonic() - started > DESCRIBED_S:
                raise TimeoutError(f"the good descriptions were not in force again within {DESCRIBED_S:.0f} s")
        self.described_s = max(self.described_s, time.monotonic() - started)

    def _describe(self) -> None:
        for topic, raw in self.descriptions.items():
            self._publishers[topic].publish(raw)

    def _publish(self, topic: str, raw: bytes) -> None:
        self._publishers[topic].publish(raw)
        self.sent[topic] += 1

    def _stamp(self, begin_ns: int) -> int:
        self._stamps += 1
        return begin_ns + self._stamps * 2 * S      # farther apart than gap_s: no good frame is late after another

    def _send_good(self) -> None:
        kind, stamp_ns = self._random.choice(GOOD), self._stamp(GOOD_NS)
        self._awaited[stamp_ns] = kind, time.monotonic()
        self._publish(kind, cdr.restamp(self.frames[kind], stamp_ns))
        self.good += 1

    def _cloud_of(self, kind: str, patience_s: float = 0.5) -> bytes:
        """The cloud of a frame that is not counted as good, without its stamp; empty if none comes."""
        stamp_ns = self._stamp(PROBE_NS)
        self._probed[stamp_ns] = b""
        self._publish(kind, cdr.restamp(self.frames[kind], stamp_ns))
        self._wait(lambda: self._probed[stamp_ns], LOST_S if not self._awaited and kind not in self._expected
                   else patience_s)
        return self._probed.pop(stamp_ns)

    def _on_cloud(self, raw: bytes) -> None:
        stamp_ns = int.from_bytes(raw[4:8], "little", signed=True) * S + int.from_bytes(raw[8:12], "little")
        content = raw[:STAMP.start] + raw[STAMP.stop:]
        if stamp_ns in self._probed:
            self._probed[stamp_ns], self._raw = content, raw
        elif stamp_ns in self._awaited:
            kind, since_s = self._awaited.pop(stamp_ns)
            self.slowest_s = max(self.slowest_s, time.monotonic() - since_s)
            self.wrong += content != self._expected[kind]

    def _wait_for_clouds(self, allowed: int) -> None:
        if not self._wait(lambda: len(self._awaited) <= allowed, LOST_S):
            self.lost += len(self._awaited)
            self._awaited.clear()

    def _wait(self, condition, timeout_s: float) -> bool:
        end = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True


def main() -> int:
    assert transport
    arguments = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    arguments.add_argument("--messages", type=int, default=1_000_000, help="mutated messages (%(default)s)")
    arguments.add_argument("--seed", type=int, default=1, help="of all choices (%(default)s)")
    arguments.add_argument("--hang-s", type=float, default=1.0, help="longest time to a good cloud (%(default)s)")
    arguments.add_argument("--out", type=Path, default=Path("build/attacks/mutate.json"), help="result (%(default)s)")
    args = arguments.parse_args()
    given = os.environ.get("ROS_DOMAIN_ID")
    join_private_network()
    os.environ["ROS_DOMAIN_ID"] = given or os.environ["ROS_DOMAIN_ID"]
    folder = args.out.absolute().with_suffix("")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    small = {"lossless": True, "sketch_size": 4}
    stack = Stack({"sketcher": small, "reconstructor": {"lossless": True, "fields": "full"},
                   "recorder": {"path": str(folder / "mutate.rrd"), "lossless": True}})
    problems: list[str] = []
    with stack:
        attack, started = Attack(stack, args.seed, args.hang_s), time.monotonic()
        try:
            attack.begin(args.seed)
            campaign(attack, stack, args.messages)
        except TimeoutError as error:
            problems.append(str(error))
        seconds = time.monotonic() - started
        problems += judge(attack, stack, args.hang_s)
        attack.close()
    for name, process in stack.processes.items():
        if process.returncode:
            problems.append(f"{name} ended with {process.returncode}")
        problems += sorted({f"{name}: {line.partition(']: ')[2] or line}" for line in process.lines
                            if UNEXPECTED.search(line)})
    mutated = attack.mutated.total()
    facts = {"seed": args.seed, "mutated_messages": mutated, "by_topic": dict(attack.mutated),
             "good_frames": attack.good,
             "lost": attack.lost, "not_bit_equal": attack.wrong, "slowest_good_s": round(attack.slowest_s, 3),
             "slowest_description_s": round(attack.described_s, 3), "seconds": round(seconds, 1),
             "messages_per_s": round(mutated / seconds), "problems": problems,
             "accounting": {name: {key: value for key, value in stack.counts.latest.get(name, {}).items()
                              if value.lstrip("-").isdecimal()} for name in NODES}}
    write_result(args.out.absolute(), facts)
    if not problems:
        shutil.rmtree(folder)
    print(f"{'FAILED' if problems else 'held'}: {mutated} mutated messages in {seconds:.0f} s, {attack.good} good "
          f"frames, {attack.lost} lost, {attack.wrong} changed, slowest {attack.slowest_s:.2f} s"
          + "".join(f"\n  {problem}" for problem in problems))
    return 1 if problems else 0


def campaign(attack: Attack, stack: Stack, messages: int) -> None:
    """Round after round, until so many mutated messages were sent or a process has ended."""
    with tqdm(total=messages, unit="msg", smoothing=0.05) as bar:
        while bar.n < messages and not stack.dead():
            data = min(DATA, messages - bar.n)
            attack.frames_round(data)
            described = min(DESCRIPTIONS, messages - bar.n - data)
            attack.descriptions_round(described)
            stack.spin(0.0)
            bar.update(data + described)
            bar.set_postfix(good=attack.good, lost=attack.lost, wrong=attack.wrong, slowest=f"{attack.slowest_s:.2f} s")


def judge(attack: Attack, stack: Stack, hang_s: float) -> list[str]:
    """A line for each promise that did not hold."""
    problems = stack.dead()
    if attack.lost or attack.wrong:
        problems.append(f"of {attack.good} good frames {attack.lost} were lost and {attack.wrong} became another cloud")
    if attack.slowest_s > hang_s:
        problems.append(f"a good frame took {attack.slowest_s:.2f} s: expected at most {hang_s:g} s")

    def counts() -> list[str]:
        found = []
        for name in NODES:
            report = stack.counts.latest.get(name, {})
            found += [f"{name}: {key} is {report.get(key)}" for key in ("under_way", "unaccounted_frames")
                      if report.get(key) != "0"]
            if "dropped.error" in report:
                found.append(f"{name}: {report['dropped.error']} messages failed and were not refused: "
                             f"{report['last_error']}")
        report = stack.counts.latest.get("sketcher", {})
        came, sent = (int(report.get(key, 0)) for key in ("frames_in", "message_lost")), attack.sent
        if sum(came) != sent["photons"] + sent["gates"]:
            found.append(f"sketcher: {sent['photons'] + sent['gates']} messages were sent to it, and it knows of less")
        return found

    stack.wait(lambda: not counts(), "frame accounting that adds up", must=False)
    return problems + counts()


if __name__ == "__main__":
    sys.exit(main())
