"""Bags that tests write."""

from pathlib import Path

from srt3d_ros.datasets.bags.writer import BagWriter

CLOUD, IMAGE, TEXT = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "std_msgs/msg/String"
START_NS, MS = 1_600_000_000_000_000_000, 1_000_000


def write_bag(path: Path, messages: list[tuple], storage: str = "mcap", first: int = 0) -> Path:
    """A bag of (topic, type, bytes), or (topic, type, bytes, ms); by default a ms after each other, `first` on."""
    writer = BagWriter(path, storage)
    for k, (topic, message_type, raw, *at_ms) in enumerate(messages, first):
        if topic not in writer:
            writer.add_topic(topic, message_type, latched=message_type == TEXT)
        writer.write(topic, START_NS + (at_ms or [k])[0] * MS, raw)
    writer.close()
    return path
