"""Writing rosbag2 bags with rosbags: serialised messages as they came."""

import contextlib
import errno
import sqlite3
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

STORAGES = ("mcap", "sqlite3")
VERSION = 9                             # of metadata.yaml: what rosbag2 of Jazzy writes
DEPTH = 10                              # of what the publishers offered, as rosbag2 writes it


class BagWriter:
    """A bag that is being written: a folder with one storage file and, once closed, metadata.yaml.

    It belongs to the thread that made it: SQLite wants that.

    Raises:
        InvalidInput: something is there already, or nothing can be written there.
    """

    def __init__(self, path: str | Path, storage: str = STORAGES[0]):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        require(storage in STORAGES, "storage", storage, " or ".join(STORAGES))
        self.path = Path(path)
        require(not self.path.exists() and not self.path.is_symlink(), "bag", str(path), "a folder that is not there")
        try:
            self._writer = Writer(self.path, version=VERSION, storage_plugin=StoragePlugin[storage.upper()])
            self._writer.open()
        except OSError as error:
            raise InvalidInput("bag", str(path), f"a folder that can be made ({error.strerror})") from None
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, object] = {}
        self.messages: Counter[str] = Counter()
        self.bytes = 0
        self.first_ns = self.last_ns = 0

    @property
    def duration_s(self) -> float:
        """From the first message to the last."""
        return (self.last_ns - self.first_ns) * 1e-9

    def add_topic(self, name: str, message_type: str, latched: bool = False) -> None:
        """Describe a topic, such as "/photons" of "sensor_msgs/msg/PointCloud2", before its first message."""
        self._connections[name] = self._writer.add_connection(
            name, message_type, typestore=self._types, offered_qos_profiles=[_qos(latched)])

    def __contains__(self, name: str) -> bool:
        return name in self._connections

    def write(self, name: str, time_ns: int, raw: bytes) -> None:
        """Append a serialised message that came at `time_ns` since 1970, the order in which it is read again.

        Raises:
            OSError: it cannot be written, because the disk is full, say.
        """
        with _os_errors():
            self._writer.write(self._connections[name], time_ns, raw)
        self.first_ns = min(time_ns, self.first_ns) if self.bytes else time_ns
        self.last_ns = max(time_ns, self.last_ns)
        self.messages[name] += 1
        self.bytes += len(raw)

    def close(self) -> None:
        """Complete the bag; OSError if that fails."""
        with _os_errors():
            self._writer.close()

    def abandon(self) -> None:
        """Close the files of a bag that can no longer be written, which leaves it incomplete (docs/bags.md)."""
        with contextlib.suppress(OSError, sqlite3.Error):       # it tries once more to write what it could not
            self._writer.abort()


@contextlib.contextmanager
def _os_errors() -> Iterator[None]:
    """Raise SQLite's errors about files as OSError."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise OSError(errno.EIO, str(error)) from None


def _qos(latched: bool):
    """What a publisher offered: reliable, and transient local if `latched`."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(*divmod(2**63 - 1, 1_000_000_000))
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return Qos(QosHistory.KEEP_LAST, 1 if latched else DEPTH, QosReliability.RELIABLE, durability, forever, forever,
               QosLiveliness.AUTOMATIC, forever, avoid_ros_namespace_conventions=False)
