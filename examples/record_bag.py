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


class BagRecorder(Node):
    """Subscribes to topics as their publishers offer them, and writes what they send."""

    def __init__(self, writer: Writer, topics: list[str]):
        super().__init__("record_bag", enable_rosout=False)
        self.writer, self.messages, self.wanted = writer, dict.fromkeys(topics, 0), set(topics)
        self.last_begun_s = None        # when the last of the topics had its first message

    def find_publishers(self) -> None:
        for topic in sorted(self.wanted):
            for publisher in self.get_publishers_info_by_topic(topic)[:1]:
                self.wanted.remove(topic)
                self.record(topic, publisher)

    def record(self, topic: str, publisher: TopicEndpointInfo) -> None:
        qos, never = publisher.qos_profile, interfaces.QosTime(0, 0)
        offered = interfaces.Qos(interfaces.QosHistory.KEEP_LAST, WAITING, interfaces.QosReliability(qos.reliability),
                                 interfaces.QosDurability(qos.durability), never, never,
                                 interfaces.QosLiveliness.AUTOMATIC, never, False)
        connection = self.writer.add_connection(topic, publisher.topic_type, typestore=TYPES,
                                                offered_qos_profiles=[offered])

        def write(message: bytes) -> None:
            self.messages[topic] += 1
            self.writer.write(connection, time.time_ns(), message)
            if self.last_begun_s is None and all(self.messages.values()):
                self.last_begun_s = time.monotonic()

        package, _, name = publisher.topic_type.split("/")
        wanted = QoSProfile(depth=WAITING, reliability=qos.reliability, durability=qos.durability)
        self.create_subscription(getattr(import_module(f"{package}.msg"), name), topic, write, wanted, raw=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", help="folder for the bag; a new one")
    parser.add_argument("topics", nargs="+", help="such as /sensor /photons")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end so long after all topics have begun")
    args = parser.parse_args()
    if os.path.lexists(args.bag):
        parser.error(f"{args.bag} exists: give a new folder")
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    with Writer(args.bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        recorder = BagRecorder(writer, args.topics)
        print(f"waiting for {' '.join(args.topics)}; Ctrl-C ends the bag", flush=True)
        try:
            while recorder.last_begun_s is None or time.monotonic() < recorder.last_begun_s + args.seconds:
                recorder.find_publishers()
                rclpy.spin_once(recorder, timeout_sec=LOOK_S)
        except KeyboardInterrupt:
            before = None
            while before != (before := dict(recorder.messages)):       # write the messages that wait
                rclpy.spin_once(recorder, timeout_sec=0)
    print("\n".join(f"{topic}: {number:,} messages" for topic, number in recorder.messages.items()))


if __name__ == "__main__":
    main()
