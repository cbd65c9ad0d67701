"""Open a file of a bag with rosbags or, if it was cut off, with readers of each whole message before the damage."""

import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, closing, suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"             # a file begins and ends with it
HEAD = struct.Struct("<BQ")         # of a record: its kind and length
SCHEMA, CHANNEL, MESSAGE, CHUNK = 3, 4, 5, 6
MESSAGE_HEAD = struct.Struct("<HIQQ")       # channel, sequence, time of recording, time of publishing
MAX_RECORD_BYTES = 2**28            # the largest messages have 180 MB
SQLITE_LIMIT_LENGTH = 0             # SQLite's number of this limit


class Connection(NamedTuple):
    """A topic of a file, with the names that rosbags uses."""

    topic: str
    msgtype: str
    msgcount: int


def is_cut(path: Path) -> bool:
    """Whether a file is the beginning of an .mcap file, down to none of it."""
    if path.suffix.lower() != ".mcap":
        return False
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        file.seek(max(path.stat().st_size - len(MAGIC), len(MAGIC)))
        return MAGIC.startswith(begin) and file.read() != MAGIC


def open_file(file: Path, stack: ExitStack, most_bytes: int):
    """A reader of an .mcap or .db3 file, of rosbags or a CutFile, open until the end of the stack.

    Args:
        most_bytes: of a message; SQLite may compute huge ones.
    """
    from rosbags.rosbag2 import Reader  # imported here: only bags need it

    if is_cut(file):
        return CutFile(file, _of_mcap)
    try:
        reader = stack.enter_context(Reader(file))
    except Exception:
        if file.suffix.lower() == ".mcap":
            raise
        return CutFile(file, _of_database)
    if hasattr(reader.storage, "dbconn"):
        reader.storage.dbconn.limit(SQLITE_LIMIT_LENGTH, most_bytes)
    return reader


class CutFile:
    """What is left of a file that was cut off, with what `Bag` uses of a reader of rosbags; reads it once to count.

    Messages come in the order of recording. `start_time` is the smallest time of a message in nanoseconds.

    Args:
        whole: gives (topic, type), time and bytes of each message of the file before the first that is damaged.
    """

    def __init__(self, path: Path, whole: Callable[[Path], Iterator[tuple[tuple[str, str], int, bytes]]]):
        self._messages = partial(whole, path)
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


def _of_database(path: Path) -> Iterator[tuple[tuple[str, str], int, bytes]]:
    import apsw

    uri = f"{path.absolute().as_uri()}?immutable=1"
    with closing(apsw.Connection(uri, flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)) as database:
        database.limit(SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES)
        database.execute("PRAGMA writable_schema = ON")     # otherwise SQLite opens no file that lacks pages
        topics = {number: tuple(names) for number, *names in database.execute("SELECT id, name, type FROM topics")}
        with suppress(Exception):       # at the first damaged page or row
            for number, time_ns, raw in database.execute("SELECT topic_id, timestamp, data FROM messages"):
                yield topics[number], time_ns, raw


def _of_mcap(path: Path) -> Iterator[tuple[tuple[str, str], int, bytes]]:
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    schemas, channels = {}, {}
    with suppress(Exception):       # of the libraries that parse and unpack a damaged record
        for kind, content in _records(path):
            if kind == SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(content)))
                schemas[schema.id] = schema.name
            elif kind == CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(content)))
                channels[channel.id] = channel.topic, schemas[channel.schema_id]
            elif kind == MESSAGE:
                number, _, time_ns, _ = MESSAGE_HEAD.unpack_from(content)
                yield channels[number], time_ns, content[MESSAGE_HEAD.size:]


def _records(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each record of an .mcap file, of chunks those inside."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from rosbags.rosbag2.storage_mcap import decompress

    with path.open("rb") as file:
        file.seek(len(MAGIC))
        for kind, content in _whole_records(file, path.stat().st_size):
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
