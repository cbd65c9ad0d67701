"""A sensor driver on command, which may misbehave: sends prebuilt packets of `photons`, restamped.

    python robustness/driver.py FOLDER

FOLDER holds a folder for each sensor: `sensor.json`, and packets as CDR bytes, NUMBER.cdr, which are sent in turn. Each
line of standard input is a JSON object with settings to change; the answer is a line of JSON with what was done so far.
A stamp is where acquisition begins, one interval before the packet is sent. What could not be sent in time is skipped,
as by a sensor whose buffer is full.

    sensor: str         be this sensor from now on; "" sends nothing
    rate_hz: float      packets a second
    lose, double, late, cut: float      share of the packets that are lost, sent twice, sent late, sent in part
    odometry: str       with each packet where the robot is, which moves along the scene: "good", or "late", or with a
                        "leap" of its clock, some with a "jump" or "nan"; "" none
    imu: str            with each packet how it turns, which is not at all: "good", some "nan" or "fast"; "" none
    depth: str          with each packet an image of another "size", or of "nan"; "" none
"""

import json
import math
import random
import select
import signal
import sys
import time
from collections import Counter, deque
from pathlib import Path

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image, Imu, PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr, images
from srt3d_ros.nodes import transport
from srt3d_ros.nodes.diagnostics import all_acknowledged
from srt3d_ros.nodes.topics import LATCHED

FATES = ("lose", "double", "late", "cut")
LATE_S = 0.35           # of a late packet
BEHIND_NS = 50_000_000  # further behind than this, and packets are skipped
DESCRIBED_S = 5.0       # nobody may be there to receive the description
DEPTH = 10
SPEED_M_S = 0.3         # to the right
FAST_RAD_S, WRONG_SHAPE = 100.0, (7, 5)
DEPTH_OLD_NS = 200_000_000      # as of the last cloud
ODOM_LATE_NS, LEAP_NS, JUMP_M = 400_000_000, 100_000_000_000, 2.0


class Driver:
    def __init__(self, folder: Path):
        self._folder = folder
        self._settings = dict.fromkeys(("sensor", "odometry", "imu", "depth"), "") | {"rate_hz": 40.0}
        self._settings |= dict.fromkeys(FATES, 0.0)
        self._done: Counter[str] = Counter()
        self._node = rclpy.create_node("driver")
        self._description = self._node.create_publisher(String, "sensor", LATCHED)
        self._publisher = self._node.create_publisher(PointCloud2, "photons", DEPTH)
        self._odometry = self._node.create_publisher(Odometry, "odom", DEPTH)
        self._imu = self._node.create_publisher(Imu, "imu", DEPTH)
        self._depth = self._node.create_publisher(Image, "depth", DEPTH)
        self._packets: list[bytes] = []
        self._held: deque[tuple[float, bytes]] = deque()        # late packets, until when
        self._random = random.Random(0)

    def run(self) -> None:
        number, begins_ns = 0, time.time_ns()
        while True:
            packets, period_ns = self._packets, round(1e9 / self._settings["rate_hz"])
            self._wait_until(begins_ns + period_ns)
            if not packets or packets is not self._packets:
                number, begins_ns = 0, time.time_ns()
                continue
            if time.time_ns() - begins_ns - period_ns > BEHIND_NS:
                self._done["skipped"] += 1
            else:
                self._packet(cdr.restamp(packets[number % len(packets)], begins_ns))
            if self._settings["odometry"]:
                self._report(number, begins_ns + period_ns)
            if self._settings["imu"]:
                self._report_turn(number, begins_ns + period_ns)
            if self._settings["depth"]:
                shape = WRONG_SHAPE if self._settings["depth"] == "size" else self._shape
                image = np.full(shape, math.nan, np.float32)
                self._depth.publish(images.encode_cdr(image, begins_ns - DEPTH_OLD_NS, "spad"))
            number += 1
            begins_ns += period_ns

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
            self._packets = []
            self._send_held(float("inf"))
        elif self._settings["sensor"] != was:
            folder = self._folder / self._settings["sensor"]
            description = (folder / "sensor.json").read_text()
            self._shape = tuple(json.loads(description)[key] for key in ("rows", "cols"))
            self._description.publish(String(data=description))
            end = time.monotonic() + DESCRIBED_S        # photons that overtake it would be read with the one before
            while time.monotonic() < end and not (self._description.get_subscription_count()
                                                  and all_acknowledged(self._description)):
                time.sleep(0.01)
            self._held.clear()
            self._packets = [path.read_bytes() for path in sorted(folder.glob("*.cdr"))]

    def _packet(self, packet: bytes) -> None:
        self._send_held(time.monotonic())
        shares = [self._settings[fate] for fate in FATES]
        (fate,) = self._random.choices((*FATES, "send"), [*shares, 1 - sum(shares)])
        self._done[fate] += 1
        if fate == "late":
            self._held.append((time.monotonic() + LATE_S, packet))
        elif fate != "lose":
            self._send(packet[:len(packet) // 2] if fate == "cut" else packet)
            if fate == "double":
                self._send(packet)

    def _report(self, number: int, now_ns: int) -> None:
        report = Odometry(child_frame_id="base_link")
        if self._settings["odometry"] == "late":
            now_ns -= ODOM_LATE_NS
        report.pose.pose.position.x, report.twist.twist.linear.x = SPEED_M_S * (now_ns % 10**12) / 1e9, SPEED_M_S
        match self._settings["odometry"]:
            case "leap":
                now_ns -= LEAP_NS
            case "jump":
                report.pose.pose.position.x += JUMP_M * (number // 10 % 2)
            case "nan" if number % 3 == 0:
                report.pose.pose.position.y = math.nan
        report.header.stamp.sec, report.header.stamp.nanosec = divmod(now_ns, 10**9)
        self._odometry.publish(report)

    def _report_turn(self, number: int, now_ns: int) -> None:
        report, harm = Imu(), self._settings["imu"]
        if harm != "good" and number % 3 == 0:
            report.angular_velocity.z = {"nan": math.nan, "fast": FAST_RAD_S}[harm]
        report.header.frame_id = "imu_link"
        report.header.stamp.sec, report.header.stamp.nanosec = divmod(now_ns, 10**9)
        self._imu.publish(report)

    def _send_held(self, now: float) -> None:
        while self._held and self._held[0][0] <= now:
            self._send(self._held.popleft()[1])

    def _send(self, packet: bytes) -> None:
        self._publisher.publish(packet)
        self._done["sent"] += 1
        self._done["bytes"] += len(packet)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)        # any signal ends it at once
    transport.prepare_process()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    driver = Driver(Path(sys.argv[1]))
    print("ready", flush=True)
    driver.run()
