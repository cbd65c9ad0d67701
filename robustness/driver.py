"""A sensor driver that misbehaves on command: packets of `photons`, several a frame, at 10 frames a second.

    python robustness/driver.py FOLDER

FOLDER holds a folder for each sensor: `sensor.json` and the packets of a frame as CDR bytes, *.cdr. Each line of
standard input is a JSON object with settings to change; the answer is a line of JSON with what was done so far.

    sensor: str         be this sensor from now on; "" sends nothing
    lose, double, late, cut: float      share of the packets that are lost, sent twice, sent late, sent in part
    shuffle: bool       a frame's packets come together, in any order
    shift_s: float      added to the stamps
"""

import json
import random
import select
import signal
import sys
import time
from collections import Counter, deque
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr
from srt3d_ros.nodes import transport
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.topics import LATCHED

FRAME_NS = 100_000_000
LATE_S = 0.35           # three frames
BEHIND_NS = 500_000_000     # further behind than this, as after a stop, and what was missed is not sent
DESCRIBED_S = 5.0       # nobody may be there to receive the description


class Driver:
    def __init__(self, folder: Path):
        self._folder = folder
        self._settings = {"sensor": "", "lose": 0.0, "double": 0.0, "late": 0.0, "cut": 0.0, "shuffle": False,
                          "shift_s": 0.0}
        self._done: Counter[str] = Counter()
        self._node = rclpy.create_node("driver")
        self._description = self._node.create_publisher(String, "sensor", LATCHED)
        self._publisher = self._node.create_publisher(PointCloud2, "photons", 10)
        self._packets: list[bytes] = []
        self._held: deque[tuple[float, bytes]] = deque()        # late packets, until when
        self._random = random.Random(0)

    def run(self) -> None:
        due_ns = 0
        while True:
            if not self._settings["sensor"] or time.time_ns() - due_ns > BEHIND_NS:
                due_ns = time.time_ns() + FRAME_NS // 10
                self._wait_until(due_ns)
            else:
                self._frame(due_ns)
                due_ns += FRAME_NS

    def _wait_until(self, due_ns: int) -> None:
        """Obey commands until then."""
        while select.select([sys.stdin], [], [], max(due_ns - time.time_ns(), 0) * 1e-9)[0]:
            line = sys.stdin.readline() or sys.exit()
            self._change(json.loads(line))
            print(json.dumps(self._done), flush=True)

    def _change(self, settings: dict) -> None:
        was = self._settings["sensor"]
        self._settings |= settings
        if not self._settings["sensor"]:
            self._send_held(float("inf"))
        elif self._settings["sensor"] != was:
            folder = self._folder / self._settings["sensor"]
            self._description.publish(String(data=(folder / "sensor.json").read_text()))
            end = time.monotonic() + DESCRIBED_S        # photons that overtake it would be read with the one before
            while time.monotonic() < end and not (self._description.get_subscription_count()
                                                  and all_acknowledged(self._description)):
                time.sleep(0.01)
            self._held.clear()
            self._packets = [path.read_bytes() for path in sorted(folder.glob("*.cdr"))]

    def _frame(self, begins_ns: int) -> None:
        """Send the packets of one frame, each when its acquisition has ended."""
        packets, period_ns = self._packets, FRAME_NS // len(self._packets)
        order = list(range(len(packets)))
        if shuffled := self._settings["shuffle"]:
            self._random.shuffle(order)
            self._done["shuffle"] += 1
        for place, k in enumerate(order):
            self._wait_until(begins_ns + (len(packets) if shuffled else place + 1) * period_ns)
            if not self._settings["sensor"] or packets is not self._packets:     # the rest is never sent
                return
            shift_ns = round(self._settings["shift_s"] * 1e9)
            self._packet(cdr.restamp(packets[k], begins_ns + k * period_ns + shift_ns))

    def _packet(self, packet: bytes) -> None:
        self._send_held(time.monotonic())
        chance = self._random.random()
        for fate in ("lose", "double", "late", "cut"):
            chance -= self._settings[fate]
            if chance < 0:
                break
        else:
            fate = "send"
        self._done[fate] += 1
        if fate == "late":
            self._held.append((time.monotonic() + LATE_S, packet))
        elif fate != "lose":
            self._send(packet[:len(packet) // 2] if fate == "cut" else packet)
            if fate == "double":
                self._send(packet)

    def _send_held(self, now: float) -> None:
        while self._held and self._held[0][0] <= now:
            self._send(self._held.popleft()[1])

    def _send(self, packet: bytes) -> None:
        self._publisher.publish(packet)
        self._done["sent"] += 1


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)        # any signal ends it at once
    transport.prepare_process()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    driver = Driver(Path(sys.argv[1]))
    print("ready", flush=True)
    driver.run()
