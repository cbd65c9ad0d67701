"""RrdFile: one .rrd file, written by us from a pipe that rerun writes into.

When a write fails (disk full, disk removed), the file sink of rerun 0.41 ends its thread. A pending flush, the next
disconnect and the exit of the process can then wait forever. Behind a pipe, rerun never sees the failure: it becomes
an OSError here, and what rerun still writes is discarded.
"""

import fcntl
import os
import select
import struct
import termios
import threading
import time
from pathlib import Path

import rerun as rr

from srt3d_ros.recording import rerun_streams

TICK_S = 0.4            # how long rerun gathers rows: a kill loses as much, and every chunk of an entity costs 1 kB
_FLUSH_TIMEOUT_S = 20.0
_HANGS = f"the disk accepted nothing for {_FLUSH_TIMEOUT_S:g} s"
_CHUNK_BYTES = 1 << 20
_POLL_S = 0.005


class RrdFile:
    """A rerun stream into a file that is complete by itself.

    Args:
        path: the file; an existing one is overwritten.
        application_id, recording_id: the viewer shows files with the same of both as one recording.

    Raises:
        OSError: if the file cannot be opened, and from `check`, `flush` and `close` once it cannot be written.
    """

    def __init__(self, path: Path, application_id: str, recording_id: str):
        self._file = open(path, "wb", buffering=0)
        self._read_end, write_end = os.pipe()
        self.bytes_written = 0
        self._error: str | None = None
        self._copying = threading.Lock()        # held from before a read until its data is written
        self._thread = threading.Thread(target=self._copy_all, name="recording file", daemon=True)
        self._thread.start()
        batches = rr.ChunkBatcherConfig(flush_tick=TICK_S)
        self.stream = rr.RecordingStream(application_id, recording_id=recording_id, batcher_config=batches)
        self.stream.save(f"/dev/fd/{write_end}")
        os.close(write_end)     # rerun's own handle is now the pipe's only writer: when rerun closes it, the file ends

    def check(self) -> None:
        """Raise the OSError of a write that failed."""
        if self._error is not None:
            raise OSError(self._error)

    def flush(self) -> None:
        """Return when all data logged so far is in the file; OSError if the disk accepts nothing for 20 s."""
        self.check()
        try:
            self.stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
        except RuntimeError as error:
            raise OSError(_HANGS) from error
        if not self._drain(_FLUSH_TIMEOUT_S):
            raise OSError(_HANGS)
        self.check()

    def close(self) -> None:
        """Write the footer and close the file."""
        self.flush()
        self._end()
        self.check()

    def abandon(self) -> None:
        """Close a file that cannot be written, without its footer. Blocks as long as the disk hangs."""
        rerun_streams.abandoned.add(self)
        self._end()

    def _end(self) -> None:
        self.stream.disconnect()
        self._thread.join()
        rerun_streams.abandoned.discard(self)
        self.stream = None
        rerun_streams.free_ended()

    def _drain(self, timeout_s: float) -> bool:
        """Wait until all data in the pipe is in the file; False after `timeout_s` seconds."""
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            if self._copying.acquire(timeout=left_s):
                try:
                    if not struct.unpack("i", fcntl.ioctl(self._read_end, termios.FIONREAD, bytes(4)))[0]:
                        return True
                finally:
                    self._copying.release()
            time.sleep(_POLL_S)
        return False

    def _copy_all(self) -> None:
        readable = select.poll()
        readable.register(self._read_end, select.POLLIN)
        with open(self._read_end, "rb", buffering=0) as pipe, self._file:
            while readable.poll() and self._copy(pipe):
                pass

    def _copy(self, pipe) -> bool:
        """Copy what the pipe holds; False once rerun has closed it."""
        with self._copying:
            data = pipe.read(_CHUNK_BYTES)
            if data and self._error is None:
                try:
                    self._write(data)
                except OSError as e:
                    self._error = e.strerror or str(e)
            return bool(data)

    def _write(self, data: bytes) -> None:
        rest = memoryview(data)
        while len(rest):
            rest = rest[self._file.write(rest):]
        self.bytes_written += len(data)
