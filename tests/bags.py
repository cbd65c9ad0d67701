"""Write bags as `ros2 bag record` does."""

from pathlib import Path

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
START_NS, MS = 1_600_000_000_000_000_000, 1_000_000
STORAGES = ("mcap", "sqlite3")


def write_bag(path: Path, messages: list[tuple], storage: str = "mcap", first: int = 0, compressed: str = "") -> Path:
    """Write a bag of (topic, type, bytes[, ms]); without ms, messages are 1 ms apart, from `first` on.

    `compressed` is a CompressionMode of rosbags: FILE, MESSAGE or STORAGE.
    """
    types, connections = get_typestore(Stores.ROS2_JAZZY), {}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compressed:
        writer.set_compression(CompressionMode[compressed], CompressionFormat.ZSTD)
    with writer:
        for k, (topic, message_type, raw, *at_ms) in enumerate(messages, first):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message_type, typestore=types)
            writer.write(connections[topic], START_NS + (at_ms or [k])[0] * MS, raw)
    return path


def write_mcap(path: Path, messages: list[tuple[str, str, bytes]], **options) -> Path:
    """Write an .mcap file as `ros2 bag record` does, 1 ms apart; options of mcap's Writer say how it is chunked."""
    from mcap.writer import Writer as McapWriter

    writer, channels = McapWriter(str(path), **options), {}
    writer.start("ros2")
    for k, (topic, message_type, raw) in enumerate(messages):
        if topic not in channels:
            schema = writer.register_schema(message_type, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic], START_NS + k * MS, raw, START_NS + k * MS)
    writer.finish()
    return path
