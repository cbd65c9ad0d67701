"""A sensor driver for benchmarks: sends prebuilt messages at given rates, restamped, whoever keeps up with them.

    PYTHONPATH=. python benchmarks/driver.py FOLDER gates 100:60,500:10,100:10

FOLDER holds `sensor.json` and the messages as CDR bytes, *.cdr, which are sent in turn. Each `rate:seconds` is a phase.
A stamp is where the packet's acquisition begins, one interval of the first rate before it is sent. What could not be
sent in time is skipped, as by a sensor whose buffer is full. Ends with one JSON line.
"""

import argparse
import json
import time
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.messages import cdr
from srt3d_ros.nodes import transport

TYPES = {"gates": Image, "photons": PointCloud2}
PATIENCE_S = 60.0
BEHIND_S = 0.05         # further behind than this, and messages are skipped
DEPTH = 10


def main() -> None:
    transport.prepare_process()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("topic", choices=TYPES)
    parser.add_argument("phases", type=lambda text: [tuple(map(float, part.split(":"))) for part in text.split(",")])
    args = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node("driver")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    sensor = node.create_publisher(String, "sensor", latched)
    sensor.publish(String(data=(args.folder / "sensor.json").read_text()))
    publisher = node.create_publisher(TYPES[args.topic], args.topic, QoSProfile(depth=DEPTH))
    messages = [path.read_bytes() for path in sorted(args.folder.glob("*.cdr"))]
    deadline = time.monotonic() + PATIENCE_S
    while publisher.get_subscription_count() < 1 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(1.0)         # the sensor's description is on its way; a camera, too, warms up
    print(json.dumps({"phases": send(publisher, messages, args.phases), **cpu()}), flush=True)
    time.sleep(1.0)         # let what was sent be read
    node.destroy_node()
    rclpy.try_shutdown()


def send(publisher, messages: list[bytes], phases: list[tuple[float, float]]) -> list[dict]:
    """Send all phases; what each of them was."""
    interval_ns = round(1e9 / phases[0][0])
    due_ns, number, told = time.time_ns(), 0, []
    for rate_hz, seconds in phases:
        phase = {"rate_hz": rate_hz, "began_ns": due_ns, "sent": 0, "skipped": 0, "bytes": 0}
        end_ns = due_ns + round(seconds * 1e9)
        while due_ns < end_ns:
            late_s = (time.time_ns() - due_ns) * 1e-9
            if late_s > BEHIND_S:
                phase["skipped"] += 1
            else:
                time.sleep(max(-late_s, 0))
                message = messages[number % len(messages)]
                publisher.publish(cdr.restamp(message, due_ns - interval_ns))
                number += 1
                phase["sent"] += 1
                phase["bytes"] += len(message)
            due_ns += round(1e9 / rate_hz)
        phase["ended_ns"] = due_ns
        told.append(phase)
    return told


def cpu() -> dict:
    """CPU time of this process, seconds."""
    return {"cpu_s": round(time.process_time(), 2)}


if __name__ == "__main__":
    main()
