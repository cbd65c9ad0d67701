"""rosbag2 bags (mcap or sqlite3), read with rosbags: the topics they hold, and the messages as they were recorded."""

import io
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import BinaryIO, NamedTuple

from srt3d_ros import zstd
from srt3d_ros.errors import InvalidInput, require

STORAGE_SUFFIXES = (".mcap", ".db3")
EXPECTED = "a complete rosbag2 bag (docs/bags.md tells what to do about one that was cut off)"
MAX_METADATA_BYTES = 2**19          # of a thousand files; its parser takes a second for 150 kB
MAX_BYTES = 2**30                   # of a message, and of the chunk of messages that is unpacked at once
MAX_RATIO = 100                     # of a compressed file larger than that: bags of photons come to 5
MAX_UNCHECKED_BYTES = 2**10         # zstd unpacks them to 32 MiB at most
READ_BYTES = 2**20
SQLITE = b"SQLite format 3\0"


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: its name as recorded, its type such as "sensor_msgs/msg/PointCloud2", how many messages."""

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

    rosbags fails in many ways on bags that lie or were cut off, and unpacks as much as comes. Here every failure is
    one InvalidInput, on opening or at the message at which a bag breaks off, and nothing unpacks beyond MAX_BYTES.

    Args:
        path: the folder of a bag, or one of its .mcap or .db3 files.

    Attributes:
        topics: that it has.
        has_index: whether messages of a certain time can be read without those before.

    Raises:
        InvalidInput: there is no bag that can be read.
    """

    def __init__(self, path: str | Path):
        from rosbags.rosbag2 import Reader  # here: only bags need rosbags

        self.path = Path(path)
        self._check_path()
        with self._one_error(), ExitStack() as stack:
            files, self._messages_are_packed = self._storage_files(stack)
            for file in files:
                _check_database(file)
            readers = [stack.enter_context(Reader(_BoundedPath(file))) for file in files]
            self._readers = sorted(readers, key=lambda reader: reader.start_time)
            counts = Counter()
            for connection in (connection for reader in self._readers for connection in reader.connections):
                counts[connection.topic, connection.msgtype] += connection.msgcount
            self._files = stack.pop_all()
        self.topics = tuple(BagTopic(*key, count) for key, count in counts.items())
        # An mcap file may have been written without chunks, or cut off its index: rosbags reads such a one whole.
        self.has_index = all(getattr(reader.storage, "chunks", True) for reader in self._readers)

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def messages(self, topics: Collection[BagTopic], start_ns: int | None = None, stop_ns: int | None = None
                 ) -> Iterator[Message]:
        """The messages of these topics in the order of their recording, those from `start_ns` to before `stop_ns`.

        Raises:
            InvalidInput: at the message at which the bag breaks off.
        """
        wanted = {(topic.name, topic.type) for topic in topics}
        with self._one_error():
            for reader in self._readers:
                connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
                if not connections:         # none would mean all
                    continue
                for connection, time_ns, raw in reader.messages(connections, start_ns, stop_ns):
                    if type(time_ns) is not int or type(raw) is not bytes:      # SQLite keeps anything anywhere
                        raise TypeError(f"a message on {connection.topic} is not bytes with a time")
                    yield Message(connection.topic, time_ns, _unpacked(raw) if self._messages_are_packed else raw)

    def content(self) -> str:
        """The bag's topics in words, for messages."""
        words = [f"{topic.name} ({topic.type}, {topic.messages})" for topic in self.topics if topic.messages]
        return ", ".join(words) or "no messages"

    def close(self) -> None:
        """Give back the files."""
        self._files.close()

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

    def _storage_files(self, stack: ExitStack) -> tuple[list[Path], bool]:
        """The bag's files, unpacked if they are compressed as a whole, and whether each message is compressed.

        rosbags' own reader of folders loses messages on topics whose QoS is written differently in metadata.yaml and in
        the files.
        """
        if not self.path.is_dir():
            return [self.path], False
        from ruamel.yaml import YAML  # comes with rosbags

        content = YAML(typ="safe").load((self.path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        files = [self.path / PurePath(name).name for name in content["relative_file_paths"]]
        mode = (content.get("compression_mode") or "").lower()
        if mode == "file":
            folder = Path(stack.enter_context(TemporaryDirectory()))
            files = [_unpacked_file(file, folder) for file in files]
        return files, mode == "message"

    @contextmanager
    def _one_error(self):
        try:
            yield
        except (InvalidInput, ModuleNotFoundError):
            raise
        except Exception as error:      # rosbags, its YAML parser, its decompressors and SQLite have one each, at least
            why = f"{error}" or type(error).__name__
            raise InvalidInput(f"bag {self.path.name}", f"unreadable ({why})", EXPECTED) from None


class _BoundedPath(type(Path())):
    """A path whose file gives no compressed chunk of messages that unpacks to more than MAX_BYTES."""

    def open(self, *args, **kwargs) -> BinaryIO:
        return _BoundedFile(io.FileIO(self))


class _BoundedFile(io.BufferedReader):
    def read(self, size: int | None = -1) -> bytes:
        """What the file has; ValueError if it is a compressed chunk, or a record of one, that unpacks to too much."""
        data = super().read(size)
        if len(data) > MAX_UNCHECKED_BYTES:
            header_bytes = 40 + int.from_bytes(data[28:32], "little")       # of a chunk's record in an mcap file
            _check_unpacked_size(data)
            _check_unpacked_size(data[header_bytes:])
        return data


def _check_unpacked_size(data: bytes) -> None:
    """Raise ValueError if data unpack to more than MAX_BYTES; those that do not unpack are left to rosbags."""
    import lz4.frame

    for open_packed in (zstd.open, lz4.frame.open):
        size = 0
        try:
            with open_packed(io.BytesIO(data), "rb") as packed:
                while size <= MAX_BYTES and (part := packed.read(READ_BYTES)):
                    size += len(part)
        except (zstd.ZstdError, RuntimeError, EOFError):
            pass
        if size > MAX_BYTES:
            raise ValueError(f"more than {MAX_BYTES} bytes unpacked")


def _unpacked(raw: bytes) -> bytes:
    """A message that was compressed by itself."""
    decompressor = zstd.ZstdDecompressor()
    message = decompressor.decompress(raw, max_length=MAX_BYTES)
    if not decompressor.eof:
        raise ValueError(f"cut off, or more than {MAX_BYTES} bytes unpacked")
    return message


def _unpacked_file(path: Path, folder: Path) -> Path:
    """Unpack a storage file into the folder; InvalidInput if it becomes far too large."""
    most = max(MAX_BYTES, MAX_RATIO * path.stat().st_size)
    with zstd.open(path, "rb") as packed, (folder / path.stem).open("wb") as file:
        while part := packed.read(READ_BYTES):
            require(file.tell() + len(part) <= most, f"{path.name} size", f"more than {most} bytes unpacked",
                    f"at most {most}")
            file.write(part)
    return folder / path.stem


def _check_database(path: Path) -> None:
    """Refuse a database that computes its rows, which may be endless; ValueError or sqlite3.Error."""
    with path.open("rb") as file:
        if file.read(len(SQLITE)) != SQLITE:
            return
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        views = database.execute("SELECT name FROM sqlite_master WHERE rootpage = 0").fetchone()
        columns = database.execute("SELECT m.name FROM sqlite_master AS m, pragma_table_xinfo(m.name) AS c "
                                   "WHERE m.type = 'table' AND c.hidden > 0").fetchone()
    if views or columns:
        raise ValueError(f"{(views or columns)[0]} is computed, not stored")
