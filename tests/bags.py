"""Write bags as `ros2 bag record` does."""

from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
START_NS, MS = 1_600_000_000_000_000_000, 1_000_000
STORAGES = ("mcap", "sqlite3")


def write_bag(path: Path, messages: list[tuple], storage: str = "mcap", first: int = 0) -> Path:
    """Write a bag of (topic, type, bytes[, ms]); without ms, messages are 1 ms apart, from `first` on."""
    types, connections = get_typestore(Stores.ROS2_JAZZY), {}
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for k, (topic, message_type, raw, *at_ms) in enumerate(messages, first):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message_type, typestore=types)
            writer.write(connections[topic], START_NS + (at_ms or [k])[0] * MS, raw)
    return path
