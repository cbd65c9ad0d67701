"""Read the topics and serialised messages of rosbag2 bags (mcap or sqlite3) with rosbags."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

STORAGE_SUFFIXES = (".mcap", ".db3")
MAX_METADATA_BYTES = 2**24          # metadata.yaml has a few hundred bytes for each topic and file
MAX_CHUNK_BYTES = 2**28             # unpacked; a chunk holds whole messages, and the largest have 180 MB
COMPLETE_BAG = "a complete rosbag2 bag (docs/bags.md: how to repair one that was cut off)"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: its recorded name, its type such as "sensor_msgs/msg/PointCloud2", its number of messages."""

    name: str
    type: str
    messages: int


def is_bag(path: str | Path) -> bool:
    """Whether a path is a folder or ends in .mcap or .db3."""
    path = Path(path)
    return path.is_dir() or path.suffix.lower() in STORAGE_SUFFIXES


class Bag(AbstractContextManager):
    """A bag open for reading; a context manager. `topics` lists its topics.

    Args:
        path: the folder of a bag, or one of its .mcap or .db3 files.

    Raises:
        InvalidInput: the bag cannot be read, whatever rosbags raises.
    """

    def __init__(self, path: str | Path):
        from rosbags.rosbag2 import Reader  # imported here: only bags need it

        _limit_chunks()
        self.path = Path(path)
        with self._one_error(), ExitStack() as stack:
            readers = [stack.enter_context(Reader(file)) for file in self._storage_files()]
            for reader in readers:
                if hasattr(reader.storage, "dbconn"):       # SQLite may compute huge values: 0 is SQLITE_LIMIT_LENGTH
                    reader.storage.dbconn.limit(0, MAX_CHUNK_BYTES)
            self._readers = sorted(readers, key=lambda reader: reader.start_time)
            counts = Counter()
            for reader in readers:
                for connection in reader.connections:
                    counts[connection.topic, connection.msgtype] += connection.msgcount
            self._files = stack.pop_all()
        self.topics = tuple(BagTopic(*key, count) for key, count in counts.items())

    def __exit__(self, *exc) -> None:
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
                    yield connection.topic, raw

    def content(self) -> str:
        """The bag's topics in words, for errors."""
        words = [f"{topic.name} ({topic.type}, {topic.messages})" for topic in self.topics if topic.messages]
        return ", ".join(words) or "no messages"

    def _storage_files(self) -> list[Path]:
        """The bag's files. rosbags' reader of folders loses messages if a topic's QoS differs between files."""
        require(self.path.exists(), "bag", problem=f"{self.path}: no such bag.")
        if not self.path.is_dir():
            require(is_bag(self.path), "bag", str(self.path),
                    f"a bag's folder, or a file that ends in {' or '.join(STORAGE_SUFFIXES)}")
            return [self.path]
        metadata = self.path / "metadata.yaml"
        require(metadata.is_file(), "bag", problem=f"{self.path}: not a whole bag, as it has no metadata.yaml. "
                "`ros2 bag reindex` writes one (docs/bags.md).")
        size = metadata.stat().st_size
        require(size <= MAX_METADATA_BYTES, "bag", problem=f"bag {self.path.name}: metadata.yaml has {size} bytes, "
                f"more than {MAX_METADATA_BYTES}. `ros2 bag reindex` writes a new one.")
        files = [path for path in self.path.iterdir() if path.suffix.lower() in STORAGE_SUFFIXES]
        compressed = "compression_mode: message" in metadata.read_text(errors="replace").lower()
        require(files and not compressed, "bag", problem=f"bag {self.path.name}: its messages are compressed, or it "
                "has no .mcap or .db3 file. `ros2 bag convert` unpacks messages; chunks may be compressed.")
        return files

    @contextmanager
    def _one_error(self):
        try:
            yield
        except (InvalidInput, ModuleNotFoundError):
            raise
        except Exception as error:      # of rosbags, of its decompressors, of SQLite
            why = f"{error}" or type(error).__name__
            raise InvalidInput(f"bag {self.path.name}", f"unreadable ({why})", COMPLETE_BAG) from None


def _limit_chunks() -> None:
    """Make rosbags unpack no more of a chunk than its stated size, and at most MAX_CHUNK_BYTES."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, zstd

    def unpack(begin: Callable, data: bytes, size: int) -> bytes:
        if size > MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk has {size} bytes, more than {MAX_CHUNK_BYTES}")
        return begin().decompress(data, size + 1)

    DECOMPRESSORS.update(lz4=partial(unpack, LZ4FrameDecompressor), zstd=partial(unpack, zstd.ZstdDecompressor))
