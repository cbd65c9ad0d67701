"""Read the topics and serialised messages of rosbag2 bags (mcap or sqlite3) with rosbags."""

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from srt3d_ros.datasets.bags import storage
from srt3d_ros.errors import InvalidInput, require

STORAGE_SUFFIXES = (".mcap", ".db3")
PACKED = ".zstd"                    # behind these, of a recorder that packs whole files
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"    # begins a packed message; others begin with 00
COMPLETE_BAG = "a rosbag2 bag (docs/bags.md says what is read of a damaged one)"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: its recorded name, its type such as "sensor_msgs/msg/PointCloud2", its number of messages."""

    name: str
    type: str
    messages: int


def is_bag(path: str | Path) -> bool:
    """Whether a path is a folder, or ends in .mcap or .db3 (or in these and .zstd: Bag says how to unpack it)."""
    path = Path(path)
    return path.is_dir() or Path(path.name.removesuffix(PACKED)).suffix.lower() in STORAGE_SUFFIXES


class Bag(AbstractContextManager):
    """A bag open for reading; a context manager. `topics` lists its topics, `notes` what is missing of its files.

    What is left of an .mcap file that was cut off is read. metadata.yaml is not needed.

    Args:
        path: the folder of a bag, or one of its .mcap or .db3 files.

    Raises:
        InvalidInput: the bag cannot be read, whatever rosbags raises.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        with self._one_error(), ExitStack() as stack:
            readers = [storage.open_file(file, stack) for file in self._storage_files()]
            self.notes = tuple(reader.note for reader in readers if isinstance(reader, storage.CutFile))
            self._readers = sorted(readers, key=lambda reader: reader.start_time)
            counts = Counter()
            for reader in readers:
                for connection in reader.connections:
                    counts[connection.topic, connection.msgtype] += connection.msgcount
            self._files = stack.pop_all()
        self.topics = tuple(BagTopic(*key, count) for key, count in counts.items())

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def messages(self, topics: Collection[BagTopic]) -> Iterator[tuple[str, bytes]]:
        """Yield topic name and bytes of each message on these topics; InvalidInput where the bag breaks off."""
        wanted = {(topic.name, topic.type) for topic in topics}
        with self._one_error():
            for reader in self._readers:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                if not connections:         # rosbags takes an empty list for all
                    continue
                for connection, _, raw in reader.messages(connections):
                    if type(raw) is not bytes:      # SQLite stores any type in any column
                        raise TypeError(f"a message on {connection.topic} is not bytes")
                    yield connection.topic, _unpacked(raw) if raw.startswith(ZSTD_MAGIC) else raw

    def content(self) -> str:
        """The bag's topics in words, for errors."""
        words = [f"{topic.name} ({topic.type}, {topic.messages})" for topic in self.topics if topic.messages]
        return "; ".join([", ".join(words) or "no messages", *self.notes])

    def _storage_files(self) -> list[Path]:
        """The bag's files. rosbags' reader of folders loses messages if a topic's QoS differs between files."""
        require(self.path.exists(), "bag", problem=f"{self.path}: no such bag.")
        suffixes = " or ".join(STORAGE_SUFFIXES)
        require(is_bag(self.path), "bag", str(self.path), f"a bag's folder, or a file that ends in {suffixes}")
        inside = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
        files = [path for path in inside if is_bag(path) and path.is_file()]
        require(files, "bag", problem=f"{self.path}: no bag, as it has no file that ends in {suffixes}.")
        for path in files:
            unpacked = path.suffix != PACKED or path.with_suffix("") in files
            require(unpacked, "bag", problem=f"bag {path.name} is packed as a whole: unpack it with zstd -d {path}")
        return [path for path in files if path.suffix != PACKED]

    @contextmanager
    def _one_error(self):
        try:
            yield
        except (InvalidInput, ModuleNotFoundError):
            raise
        except Exception as error:      # of rosbags, of its decompressors, of SQLite
            reason = f"{error}" or type(error).__name__
            raise InvalidInput(f"bag {self.path.name}", f"unreadable ({reason})", COMPLETE_BAG) from None


def _unpacked(message: bytes) -> bytes:
    """A message that was packed by itself."""
    from rosbags.rosbag2.storage_mcap import zstd

    unpacker = zstd.ZstdDecompressor()
    raw = unpacker.decompress(message, storage.MAX_RECORD_BYTES)
    if not unpacker.eof:
        raise ValueError(f"a packed message is cut off, or has more than {storage.MAX_RECORD_BYTES} bytes")
    return raw
