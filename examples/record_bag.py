"""Record topics into a bag (.mcap), as `ros2 bag record` does, which pip cannot install.

    python examples/record_bag.py wall /sensor /gates --seconds 2

ends two seconds after both topics have begun, or with Ctrl-C. Needs the extras `ros` and `bags`.
"""

import argparse
import os
import time
from importlib import import_module

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags import interfaces
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

LOOK_S = 0.1        # between looks for publishers
WAITING = 1000      # messages that may wait for the disk
TYPES = get_typestore(Stores.ROS2_JAZZY)


def record(node: Node, writer: Writer, topic: str, publisher: TopicEndpointInfo, messages: dict[str, int]) -> None:
    """Subscribe to a topic as its publisher offers it, write what it sends, and count that in `messages`."""
    qos, never = publisher.qos_profile, interfaces.QosTime(0, 0)
    offered = interfaces.Qos(interfaces.QosHistory.KEEP_LAST, WAITING, interfaces.QosReliability(qos.reliability),
                             interfaces.QosDurability(qos.durability), never, never,
                             interfaces.QosLiveliness.AUTOMATIC, never, False)
    connection = writer.add_connection(topic, publisher.topic_type, typestore=TYPES, offered_qos_profiles=[offered])

    def write(message: bytes) -> None:
        messages[topic] += 1
        writer.write(connection, time.time_ns(), message)

    package, _, name = publisher.topic_type.split("/")
    wanted = QoSProfile(depth=WAITING, reliability=qos.reliability, durability=qos.durability)
    node.create_subscription(getattr(import_module(f"{package}.msg"), name), topic, write, wanted, raw=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", help="folder for the bag; a new one")
    parser.add_argument("topics", nargs="+", help="such as /sensor /photons")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end so long after all topics have begun")
    args = parser.parse_args()
    if os.path.lexists(args.bag):
        parser.error(f"{args.bag} exists: give a new folder")
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node, messages = rclpy.create_node("record_bag", enable_rosout=False), dict.fromkeys(args.topics, 0)
    wanted, end_s = set(args.topics), float("inf")
    with Writer(args.bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        print(f"waiting for {' '.join(args.topics)}; Ctrl-C ends the bag", flush=True)
        try:
            while time.monotonic() < end_s:
                for topic in sorted(wanted):
                    for publisher in node.get_publishers_info_by_topic(topic)[:1]:
                        wanted.remove(topic)
                        record(node, writer, topic, publisher, messages)
                rclpy.spin_once(node, timeout_sec=LOOK_S)
                if end_s == float("inf") and all(messages.values()):
                    end_s = time.monotonic() + args.seconds
        except KeyboardInterrupt:
            before = None
            while before != (before := dict(messages)):       # write the messages that wait
                rclpy.spin_once(node, timeout_sec=0)
    print("\n".join(f"{topic}: {number:,} messages" for topic, number in messages.items()))


if __name__ == "__main__":
    main()
