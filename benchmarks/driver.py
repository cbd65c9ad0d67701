"""A sensor driver for benchmarks: sends prebuilt messages at given rates, restamped, whoever keeps up with them.

    python benchmarks/driver.py FOLDER 100:60,500:10,100:10

FOLDER holds TOPIC.json, latched text, and NUMBER/TOPIC.cdr, messages as bytes: those of a number are sent together, the
numbers in turn. Each `rate:seconds` is a phase. A stamp is where acquisition begins, one interval of the first rate
before its messages are sent. What could not be sent in time is skipped, as by a sensor whose buffer is full. Ends with
a line of JSON.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr
from srt3d_ros.nodes import transport

CLOUDS = ("photons", "sketch", "points")        # the other topics have images
SUBSCRIBER_TIMEOUT_S = 60.0
BEHIND_S = 0.05         # further behind than this, and messages are skipped
DEPTH = 10


def main() -> None:
    folder, phases = Path(sys.argv[1]), [tuple(map(float, phase.split(":"))) for phase in sys.argv[2].split(",")]
    transport.prepare_process()
    rclpy.init()
    node = rclpy.create_node("driver")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    texts = []
    for path in folder.rglob("*.json"):
        texts.append(node.create_publisher(String, str(path.relative_to(folder).with_suffix("")), latched))
        texts[-1].publish(String(data=path.read_text()))
    packets = [{path.stem: path.read_bytes() for path in number.glob("*.cdr")}
               for number in sorted(folder.iterdir()) if number.name.isdecimal()]
    publishers = {topic: node.create_publisher(PointCloud2 if topic in CLOUDS else Image, topic,
                                               QoSProfile(depth=DEPTH)) for topic in packets[0]}
    deadline = time.monotonic() + SUBSCRIBER_TIMEOUT_S
    while not any(one.get_subscription_count() for one in publishers.values()) and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(1.0)         # the sensor's description is being delivered; a camera, too, warms up

    def publish(number: int, stamp_ns: int) -> int:
        packet = packets[number % len(packets)]
        for topic, message in packet.items():
            publishers[topic].publish(cdr.restamp(message, stamp_ns))
        return sum(map(len, packet.values()))

    sent = send(publish, phases)
    time.sleep(1.0)         # let what was sent be read
    print(json.dumps({"phases": sent, "cpu_s": round(time.process_time(), 2)}), flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


def send(publish: Callable[[int, int], int], phases: list[tuple[float, float]]) -> list[dict]:
    """Send all phases by publish(number, stamp_ns) → bytes; what was sent in each of them."""
    interval_ns = round(1e9 / phases[0][0])
    due_ns, number, done = time.time_ns(), 0, []
    for rate_hz, seconds in phases:
        phase = {"rate_hz": rate_hz, "began_ns": due_ns, "sent": 0, "skipped": 0, "bytes": 0}
        end_ns = due_ns + round(seconds * 1e9)
        while due_ns < end_ns:
            late_s = (time.time_ns() - due_ns) * 1e-9
            if late_s > BEHIND_S:
                phase["skipped"] += 1
            else:
                time.sleep(max(-late_s, 0))
                phase["bytes"] += publish(number, due_ns - interval_ns)
                phase["sent"] += 1
                number += 1
            due_ns += round(1e9 / rate_hz)
        done.append(phase | {"ended_ns": due_ns})
    return done


if __name__ == "__main__":
    main()
