"""A sensor driver that misbehaves as it is told: packets of `photons`, several a frame, at 10 frames a second.

    python scripts/attacks/bad_driver.py FOLDER

FOLDER holds a folder for every sensor: `sensor.json` and the packets of a frame as CDR bytes, *.cdr. Each line of
standard input is a JSON object with settings to change, and is answered with one line of JSON: what was done so far.

    sensor: str         be this sensor from now on; "" sends nothing
    lose, double, late: float       share of the packets that this happens to
    shuffle: bool       a frame's packets come together, in any order
    shift_s: float      added to the stamps
"""

import json
import random
import signal
import sys
import threading
import time
from collections import Counter, deque
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr
from srt3d_ros.nodes import transport
from srt3d_ros.nodes.diagnostics import all_acknowledged

FRAME_S = 0.1
LATE_S = 0.35           # three frames
BEHIND_S = 0.5          # further behind than this, as after a stop, and what was missed is not sent
DESCRIBED_S = 5.0       # nobody may be there to hear it
CALM = {"lose": 0.0, "double": 0.0, "late": 0.0, "shuffle": False, "shift_s": 0.0}


class Driver:
    """Sends packet after packet, as its settings say."""

    def __init__(self, folder: Path):
        self._folder = folder
        self.settings = {"sensor": ""} | CALM
        self.done: Counter[str] = Counter()
        self._node = rclpy.create_node("driver")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._description = self._node.create_publisher(String, "sensor", latched)
        self._publisher = self._node.create_publisher(PointCloud2, "photons", QoSProfile(depth=10))
        self._packets: list[bytes] = []
        self._held: deque[tuple[float, bytes]] = deque()        # packets to be late, until when
        self._random = random.Random(0)

    def change(self, settings: dict) -> None:
        """Behave otherwise; told what was done so far once the packet in hand is out."""
        was = self.settings["sensor"]
        self.settings |= settings
        if (name := self.settings["sensor"]) not in ("", was):
            self._description.publish(String(data=(self._folder / name / "sensor.json").read_text()))
            self._held.clear()
            self._wait_until_described()
            self._packets = [path.read_bytes() for path in sorted((self._folder / name).glob("*.cdr"))]

    def _wait_until_described(self) -> None:
        """Photons that overtake the description of their sensor would be read with that of the sensor before."""
        end = time.monotonic() + DESCRIBED_S
        heard = self._description.get_subscription_count
        while time.monotonic() < end and not (heard() and all_acknowledged(self._description)):
            time.sleep(0.01)

    def frame(self, begins_ns: int, wait_until) -> None:
        """The packets of one frame, each when its acquisition has ended."""
        packets, period_ns = self._packets, round(FRAME_S * 1e9) // max(len(self._packets), 1)
        order = list(range(len(packets)))
        if shuffled := self.settings["shuffle"]:
            self._random.shuffle(order)
            self.done["shuffled"] += 1
        for place, k in enumerate(order):
            wait_until(begins_ns + (len(packets) if shuffled else place + 1) * period_ns)
            if not self.settings["sensor"] or packets is not self._packets:     # the rest of it is never sent
                return
            self._packet(cdr.restamp(packets[k], begins_ns + k * period_ns + round(self.settings["shift_s"] * 1e9)))

    def send_held(self, now: float) -> None:
        """The packets that were kept back for long enough."""
        while self._held and (self._held[0][0] <= now or not self.settings["sensor"]):
            self._send(self._held.popleft()[1])

    def _packet(self, packet: bytes) -> None:
        chance, now = self._random.random(), time.monotonic()
        self.send_held(now)
        lose, late, double = (self.settings[name] for name in ("lose", "late", "double"))
        if chance < lose:
            self.done["lost"] += 1
        elif chance < lose + late:
            self.done["late"] += 1
            self._held.append((now + LATE_S, packet))
        else:
            self._send(packet)
            if chance >= 1 - double:
                self.done["doubled"] += 1
                self._send(packet)

    def _send(self, packet: bytes) -> None:
        self._publisher.publish(packet)
        self.done["sent"] += 1


def main() -> None:
    transport.prepare_process()
    folder, = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.SIG_DFL)        # any signal ends it, there and then
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    driver, turn = Driver(Path(folder)), threading.Lock()

    def obey() -> None:
        for line in sys.stdin:
            with turn:
                driver.change(json.loads(line))
                if not driver.settings["sensor"]:
                    driver.send_held(time.monotonic())
                print(json.dumps(driver.done), flush=True)

    def wait_until(due_ns: int) -> None:
        turn.release()
        time.sleep(max((due_ns - time.time_ns()) * 1e-9, 0))
        turn.acquire()

    print("ready", flush=True)
    threading.Thread(target=obey, daemon=True).start()
    due_ns = time.time_ns()
    turn.acquire()
    while True:
        if not driver.settings["sensor"] or time.time_ns() - due_ns > BEHIND_S * 1e9:
            wait_until(due_ns := time.time_ns() + 10_000_000)
        else:
            driver.frame(due_ns, wait_until)
            due_ns += round(FRAME_S * 1e9)


if __name__ == "__main__":
    main()
