"""Open a file of a bag with rosbags or, if an .mcap file was cut off, read its whole messages before the damage."""

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from srt3d_ros.compat import bound_rosbags
from srt3d_ros.errors import require

MAGIC = b"\x89MCAP0\r\n"            # a file begins and ends with it
MAX_RECORD_BYTES = 2**28            # the largest messages have 180 MB; a chunk holds whole messages
SQLITE_LIMIT_LENGTH = 0             # SQLite's number of this limit
JOURNALS = ("-wal", "-journal")     # behind a database's name: where SQLite keeps what it had not yet moved into it


class Connection(NamedTuple):
    """A topic of a file, with the names that rosbags uses."""

    topic: str
    msgtype: str
    msgcount: int


def open_file(file: Path, stack: ExitStack) -> Any:
    """A reader of an .mcap or .db3 file, of rosbags or a CutFile, open until the end of the stack.

    Raises:
        InvalidInput: a database that was not closed, of which rosbags would read a part.
    """
    from rosbags.rosbag2 import Reader  # imported here: only bags need it

    bound_rosbags(MAX_RECORD_BYTES)
    if _is_cut(file):
        return CutFile(file)
    for journal in (file.with_name(file.name + suffix) for suffix in JOURNALS):
        closed = not journal.is_file() or not journal.stat().st_size
        require(closed, "bag", problem=f"bag {file.name} was not closed: {journal.name} has its last messages. "
                f"sqlite3 {file.name} 'PRAGMA journal_mode = DELETE' moves them into it.")
    reader = stack.enter_context(Reader(file))
    if hasattr(reader.storage, "dbconn"):
        reader.storage.dbconn.limit(SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES)      # SQLite may compute huge messages
    return reader


def _is_cut(path: Path) -> bool:
    """Whether a file is the beginning of an .mcap file, down to none of it."""
    if path.suffix.lower() != ".mcap":
        return False
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        file.seek(max(path.stat().st_size - len(MAGIC), len(MAGIC)))
        return MAGIC.startswith(begin) and file.read() != MAGIC


class CutFile:
    """What is left of an .mcap file that was cut off, with what `Bag` uses of a reader of rosbags.

    Reads the file once to count. Messages come in the order of recording. `start_time` is the smallest time of a
    message in nanoseconds.
    """

    def __init__(self, path: Path):
        self._path, self.start_time, counts = path, 2**63 - 1, Counter()
        for topic, time_ns, _ in self._whole_messages():
            counts[topic] += 1
            self.start_time = min(self.start_time, time_ns)
        self.connections = [Connection(*topic, count) for topic, count in counts.items()]
        self.note = f"{path.name} was cut off: its {counts.total()} whole messages are read, later ones are lost"

    def messages(self, connections: Collection[Connection], start: int | None = None
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time of recording in nanoseconds and bytes of each message on these, from `start` on."""
        wanted = {(connection.topic, connection.msgtype): connection for connection in connections}
        for topic, time_ns, raw in self._whole_messages():
            if topic in wanted and time_ns >= (start or 0):
                yield wanted[topic], time_ns, raw

    def _whole_messages(self) -> Iterator[tuple[tuple[str, str], int, bytes]]:
        """Yield (topic, type), time of recording and bytes of the messages before the first damage."""
        from mcap.records import Channel, Message, Schema

        types, topics = {}, {}
        with suppress(Exception):       # of the libraries that parse and unpack a damaged record
            for record in self._records():
                if isinstance(record, Schema):
                    types[record.id] = record.name
                elif isinstance(record, Channel):
                    topics[record.id] = record.topic, types[record.schema_id]
                elif isinstance(record, Message):
                    yield topics[record.channel_id], record.log_time, record.data

    def _records(self) -> Iterator[Any]:
        """Yield each record, of chunks those inside."""
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader, breakup_chunk
        from rosbags.rosbag2.storage_mcap import decompress

        with self._path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES).records:
                if isinstance(record, Chunk):       # mcap's own decompression has no bound
                    raw = decompress(record.data, record.compression, record.uncompressed_size, record.uncompressed_crc)
                    yield from breakup_chunk(replace(record, compression="", data=raw))
                else:
                    yield record
