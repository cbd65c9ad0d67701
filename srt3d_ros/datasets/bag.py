"""rosbag2 bags (mcap or sqlite3), read with rosbags: the topics they hold, and the messages as they were recorded."""

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from srt3d_ros.errors import InvalidInput, require

STORAGE_SUFFIXES = (".mcap", ".db3")
MAX_METADATA_BYTES = 2**19     # of a thousand files; its parser takes a second for 150 kB
EXPECTED = "a complete rosbag2 bag (docs/bags.md tells what to do about one that was cut off)"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag.

    Args:
        name: as recorded, such as "/photons".
        type: of its messages, such as "sensor_msgs/msg/PointCloud2".
        messages: how many there are.
    """

    name: str
    type: str
    messages: int


class Message(NamedTuple):
    """A message of a bag: its topic's name, when it was recorded (nanoseconds since 1970), its serialised bytes."""

    topic: str
    time_ns: int
    raw: bytes


def is_bag(path: str | Path) -> bool:
    """True if the name is that of a bag: a folder, or a storage file by its suffix."""
    path = Path(path)
    return path.is_dir() or path.suffix.lower() in STORAGE_SUFFIXES


class Bag:
    """A bag that is open for reading; a context manager.

    rosbags believes what a bag says, and fails in many ways on one that lies or was cut off. Here all of them are one
    InvalidInput, on opening or at the message at which a bag breaks off.

    Args:
        path: the folder of a bag, or one of its .mcap or .db3 files.

    Raises:
        InvalidInput: there is no bag that can be read.
    """

    def __init__(self, path: str | Path):
        from rosbags.rosbag2 import Reader  # here: only bags need rosbags

        from srt3d_ros.datasets import bag_bounds

        self.path = Path(path)
        self._check_path()
        self._open, self._unpack = ExitStack(), None
        with self._one_error():
            bag_bounds.bound_chunks()
            bag_bounds.check(self.path)
            self._readers = self._open_readers(Reader, bag_bounds.message)
            counts: dict[tuple[str, str], int] = {}
            for connection in (connection for reader in self._readers for connection in reader.connections):
                key = connection.topic, connection.msgtype
                counts[key] = counts.get(key, 0) + connection.msgcount
        self.topics = tuple(BagTopic(*key, count) for key, count in counts.items())

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def messages(self, topics: Collection[BagTopic], start_ns: int | None = None) -> Iterator[Message]:
        """The messages of these topics in the order of their recording, those from `start_ns` on if given.

        Raises:
            InvalidInput: at the message at which the bag breaks off.
        """
        wanted = {(topic.name, topic.type) for topic in topics}
        with self._one_error():
            for reader in self._readers:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                if not connections:         # none would mean all
                    continue
                for connection, time_ns, raw in reader.messages(connections, start_ns):
                    if type(time_ns) is not int or type(raw) is not bytes:      # SQLite keeps anything anywhere
                        raise TypeError(f"a message on {connection.topic} is not bytes with a time")
                    yield Message(connection.topic, time_ns, self._unpack(raw) if self._unpack else raw)

    def content(self) -> str:
        """The bag's topics in words, for messages."""
        words = [f"{topic.name} ({topic.type}, {topic.messages})" for topic in self.topics if topic.messages]
        return ", ".join(words) or "no messages"

    def close(self) -> None:
        """Give back the files."""
        self._open.close()

    def _open_readers(self, reader: Callable, unpack: Callable[[bytes], bytes]) -> list:
        """A reader for each storage file, the earliest first, or one for all.

        The reader of a folder finds no messages on topics whose QoS is written differently in metadata.yaml and in the
        files, and unpacks messages without bounds; only where files are compressed does it know more than the files.
        """
        whole = reader(self.path)
        if not self.path.is_dir():
            return [self._open.enter_context(whole)]
        with whole:
            if whole.compression_mode != "file":
                self._unpack = unpack if whole.compression_mode == "message" else None
                files = [reader(storage.path) for storage in whole.storage.storages]
                return sorted((self._open.enter_context(file) for file in files), key=lambda file: file.start_time)
        return [self._open.enter_context(whole)]

    def _check_path(self) -> None:
        require(self.path.exists(), "bag", str(self.path), "a folder or file that exists")
        if self.path.is_dir():
            metadata = self.path / "metadata.yaml"
            require(metadata.is_file(), "bag", f"{self.path}, without metadata.yaml", EXPECTED)
            size = metadata.stat().st_size
            require(size <= MAX_METADATA_BYTES, f"{metadata} size", size, f"at most {MAX_METADATA_BYTES} bytes")
        else:
            require(self.path.suffix.lower() in STORAGE_SUFFIXES, "bag", str(self.path),
                    f"a bag's folder, or a file that ends in {' or '.join(STORAGE_SUFFIXES)}")

    @contextmanager
    def _one_error(self):
        try:
            yield
        except InvalidInput:
            raise
        except Exception as error:      # rosbags, its YAML parser, its decompressors and SQLite have one each, at least
            why = f"{error}" or type(error).__name__
            raise InvalidInput(f"bag {self.path.name}", f"unreadable ({why})", EXPECTED) from None
