"""FilePart: one .rrd file being written, complete by itself."""

from pathlib import Path

import rerun as rr

from srt3d_ros.recording import streams
from srt3d_ros.recording.file_sink import FileSink

TICK_S = 0.4            # how long rerun gathers rows: a kill costs as much, and every chunk of an entity 1 kB
_FLUSH_TIMEOUT_S = 2.0
_FLUSH_TRIES = 10


class FilePart:
    """A stream into a file.

    Args:
        path: the file; an existing one is overwritten.
        application_id, recording_id: the viewer shows files with the same of both as one recording.

    Raises:
        OSError: if the file cannot be opened, and from `check`, `flush` and `close` once it cannot be written.
    """

    def __init__(self, path: Path, application_id: str, recording_id: str):
        self.path = path
        self._sink = FileSink(path)
        batches = rr.ChunkBatcherConfig(flush_tick=TICK_S)
        self.stream = rr.RecordingStream(application_id, recording_id=recording_id, batcher_config=batches)
        self.stream.save(self._sink.pipe_path)
        self._sink.opened()

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._sink.bytes_written

    def check(self) -> None:
        """Raise the OSError of a write that failed."""
        if self._sink.error is not None:
            raise OSError(self._sink.error)

    def flush(self) -> None:
        """Return when all written so far is in the file; OSError if the disk takes nothing for 20 s."""
        for _ in range(_FLUSH_TRIES):
            self.check()
            try:
                self.stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            except RuntimeError:        # the time is over: a slow disk
                continue
            if self._sink.drain(_FLUSH_TIMEOUT_S):
                self.check()
                return
        raise OSError(f"the disk took nothing for {_FLUSH_TRIES * _FLUSH_TIMEOUT_S:g} s")

    def close(self) -> None:
        """Write the footer and close the file."""
        self.flush()
        self._end()
        self.check()

    def give_up(self) -> None:
        """Close a file that cannot be written; what it has stays."""
        streams.given_up.add(self)
        self._end()

    def _end(self) -> None:
        self.stream.disconnect()
        self._sink.wait()
        streams.given_up.discard(self)
        self.stream = None
        streams.let_go()
