"""rosbag2 bags (mcap or sqlite3), read with rosbags: the topics they hold, and the messages as they were recorded."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require

STORAGE_SUFFIXES = (".mcap", ".db3")
MAX_METADATA_BYTES = 2**24          # of metadata.yaml, which has a few hundred a topic and file
MAX_CHUNK_BYTES = 2**28             # unpacked: a message lies in one chunk, and the largest have 180 MB
EXPECTED = "a complete rosbag2 bag (docs/bags.md tells what to do about one that was cut off)"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: its name as recorded, its type such as "sensor_msgs/msg/PointCloud2", how many messages."""

    name: str
    type: str
    messages: int


def is_bag(path: str | Path) -> bool:
    """True if the name is that of a bag: a folder, or a storage file by its suffix."""
    path = Path(path)
    return path.is_dir() or path.suffix.lower() in STORAGE_SUFFIXES


class Bag:
    """A bag that is open for reading; a context manager.

    rosbags fails in many ways on bags that lie or were cut off. Here every failure is one InvalidInput, on opening or
    at the message at which a bag breaks off.

    Args:
        path: the folder of a bag, or one of its .mcap or .db3 files.

    Attributes:
        topics: that it has.

    Raises:
        InvalidInput: there is no bag that can be read.
    """

    def __init__(self, path: str | Path):
        from rosbags.rosbag2 import Reader  # here: only bags need rosbags

        _limit_chunks()
        self.path = Path(path)
        with self._one_error(), ExitStack() as stack:
            readers = [stack.enter_context(Reader(file)) for file in self._storage_files()]
            for reader in readers:
                if hasattr(reader.storage, "dbconn"):       # a column of a database may be computed
                    reader.storage.dbconn.limit(0, MAX_CHUNK_BYTES)         # SQLITE_LIMIT_LENGTH, of a value
            self._readers = sorted(readers, key=lambda reader: reader.start_time)
            counts = Counter()
            for connection in (connection for reader in self._readers for connection in reader.connections):
                counts[connection.topic, connection.msgtype] += connection.msgcount
            self._files = stack.pop_all()
        self.topics = tuple(BagTopic(*key, count) for key, count in counts.items())

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, *exc) -> None:
        self._files.close()

    def messages(self, topics: Collection[BagTopic]) -> Iterator[tuple[str, bytes]]:
        """Topic's name and serialised bytes of each message of these topics, in the order of their recording.

        Raises:
            InvalidInput: at the message at which the bag breaks off.
        """
        wanted = {(topic.name, topic.type) for topic in topics}
        with self._one_error():
            for reader in self._readers:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                if not connections:         # none would mean all
                    continue
                for connection, _, raw in reader.messages(connections):
                    if type(raw) is not bytes:      # SQLite keeps anything anywhere
                        raise TypeError(f"a message on {connection.topic} is not bytes")
                    yield connection.topic, raw

    def content(self) -> str:
        """The bag's topics in words, for messages."""
        words = [f"{topic.name} ({topic.type}, {topic.messages})" for topic in self.topics if topic.messages]
        return ", ".join(words) or "no messages"

    def _storage_files(self) -> list[Path]:
        """The bag's files. rosbags' own reader of folders loses messages on topics whose QoS differs between files."""
        require(self.path.exists(), "bag", str(self.path), "a folder or file that exists")
        if not self.path.is_dir():
            require(self.path.suffix.lower() in STORAGE_SUFFIXES, "bag", str(self.path),
                    f"a bag's folder, or a file that ends in {' or '.join(STORAGE_SUFFIXES)}")
            return [self.path]
        require((self.path / "metadata.yaml").is_file(), "bag", f"{self.path}, without metadata.yaml", EXPECTED)
        files = [path for path in self.path.iterdir() if path.suffix.lower() in STORAGE_SUFFIXES]
        size = (metadata := self.path / "metadata.yaml").stat().st_size
        require(size <= MAX_METADATA_BYTES, f"bag {self.path.name}", f"with a metadata.yaml of {size} bytes",
                f"at most {MAX_METADATA_BYTES}; `ros2 bag reindex` writes another")
        packed = "compression_mode: message" in metadata.read_text(errors="replace").lower()
        require(files and not packed, f"bag {self.path.name}", "compressed or without .mcap and .db3 files",
                "messages as they are: `ros2 bag convert` unpacks them; .mcap files may compress their chunks")
        return files

    @contextmanager
    def _one_error(self):
        try:
            yield
        except (InvalidInput, ModuleNotFoundError):
            raise
        except Exception as error:      # rosbags, its decompressors and SQLite have one each, at least
            why = f"{error}" or type(error).__name__
            raise InvalidInput(f"bag {self.path.name}", f"unreadable ({why})", EXPECTED) from None


def _limit_chunks() -> None:
    """Have rosbags unpack no more of an .mcap file's chunk than it says that there is, nor than MAX_CHUNK_BYTES."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, zstd

    def unpack(begin: Callable, data: bytes, size: int) -> bytes:
        if size > MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk has {size} bytes, more than {MAX_CHUNK_BYTES}")
        return begin().decompress(data, size + 1)

    DECOMPRESSORS.update(lz4=partial(unpack, LZ4FrameDecompressor), zstd=partial(unpack, zstd.ZstdDecompressor))
