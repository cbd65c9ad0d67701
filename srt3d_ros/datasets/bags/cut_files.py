"""Read files of bags that were cut off, which rosbags refuses: each whole message up to the first that is damaged."""

import struct
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"             # a file begins and ends with it
HEAD = struct.Struct("<BQ")         # of a record: its kind and length
SCHEMA, CHANNEL, MESSAGE, CHUNK = 3, 4, 5, 6
MESSAGE_HEAD = struct.Struct("<HIQQ")       # channel, sequence, time of recording, time of publishing
MAX_RECORD_BYTES = 2**28            # the largest messages have 180 MB
DATABASE_MAGIC = b"SQLite format 3\0"
DATABASE_HEAD = struct.Struct(">16sH10xI")      # magic, bytes of a page (1: 65,536), pages
SQLITE_LIMIT_LENGTH = 0             # SQLite's number of this limit


class Connection(NamedTuple):
    """A topic of a file, with the names that rosbags uses."""

    topic: str
    msgtype: str
    msgcount: int


def is_cut(path: Path) -> bool:
    """Whether a file is the beginning of an .mcap file, down to none of it, or a database without its last page."""
    with path.open("rb") as file:
        begin, size = file.read(DATABASE_HEAD.size), path.stat().st_size
        if path.suffix.lower() == ".mcap":
            file.seek(max(size - len(MAGIC), len(MAGIC)))
            return MAGIC.startswith(begin[:len(MAGIC)]) and file.read() != MAGIC
        if len(begin) < DATABASE_HEAD.size or not begin.startswith(DATABASE_MAGIC):
            return False
        _, page_bytes, pages = DATABASE_HEAD.unpack(begin)
        page_bytes = 2**16 if page_bytes == 1 else page_bytes
        file.seek(max(pages - 1, 0) * page_bytes)
        page = file.read(page_bytes)
        return len(page) < page_bytes or not any(page)      # zeros are blocks that were not written


def cut_file(path: Path) -> "CutFile":
    """What is left of a file."""
    return CutMcap(path) if path.suffix.lower() == ".mcap" else CutDatabase(path)


class CutFile:
    """What is left of a file that was cut off, with what `Bag` uses of a reader of rosbags; reads it once to count.

    Messages come in the order of recording. `start_time` is the smallest time of a message in nanoseconds.
    """

    def __init__(self, path: Path):
        self._path = path
        counts, self.start_time = Counter(), 2**63 - 1
        for topic, time_ns, _ in self._messages():
            counts[topic] += 1
            self.start_time = min(self.start_time, time_ns)
        self.connections = [Connection(*topic, count) for topic, count in counts.items()]
        self.note = f"{path.name} was cut off: its {counts.total()} whole messages are read, later ones are lost"

    def messages(self, connections: Collection[Connection], start: int | None = None
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time of recording in nanoseconds and bytes of each message on these, from `start` on."""
        wanted = {(connection.topic, connection.msgtype): connection for connection in connections}
        for topic, time_ns, raw in self._messages():
            if topic in wanted and time_ns >= (start or 0):
                yield wanted[topic], time_ns, raw

    def _messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Yield (topic, type), time and bytes of each message before the first that is damaged."""
        raise NotImplementedError


class CutDatabase(CutFile):
    """An SQLite file (.db3) that was cut off, or of which a part was not written."""

    def _messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        import apsw

        database = apsw.Connection(f"{self._path.absolute().as_uri()}?immutable=1",
                                   flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)
        with closing(database):
            database.limit(SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES)
            database.execute("PRAGMA writable_schema = ON")     # accept an index that lies in the lost part
            topics = {number: names for number, *names in database.execute("SELECT id, name, type FROM topics")}
            with suppress(Exception):       # at the first damaged page or row
                for number, time_ns, raw in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                    yield tuple(topics[number]), time_ns, raw


class CutMcap(CutFile):
    """An .mcap file that was cut off."""

    def _messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        schemas, channels = {}, {}
        with suppress(Exception):       # of the libraries that parse and unpack a damaged record
            for kind, content in self._records():
                if kind == SCHEMA:
                    schema = Schema.read(ReadDataStream(BytesIO(content)))
                    schemas[schema.id] = schema.name
                elif kind == CHANNEL:
                    channel = Channel.read(ReadDataStream(BytesIO(content)))
                    channels[channel.id] = channel.topic, schemas[channel.schema_id]
                elif kind == MESSAGE:
                    number, _, time_ns, _ = MESSAGE_HEAD.unpack_from(content)
                    yield channels[number], time_ns, content[MESSAGE_HEAD.size:]

    def _records(self) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of each record, of chunks those inside."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from rosbags.rosbag2.storage_mcap import decompress

        with self._path.open("rb") as file:
            file.seek(len(MAGIC))
            for kind, content in _whole_records(file, self._path.stat().st_size):
                if kind == CHUNK:
                    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
                    raw = decompress(chunk.data, chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc)
                    yield from _whole_records(BytesIO(raw), len(raw))
                else:
                    yield kind, content


def _whole_records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records from here on, up to one that does not fit into `size`, or zeros."""
    while len(head := file.read(HEAD.size)) == HEAD.size:
        kind, length = HEAD.unpack(head)
        if not kind or length > min(size - file.tell(), MAX_RECORD_BYTES):
            return
        yield kind, file.read(length)
