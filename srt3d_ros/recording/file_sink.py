"""The file under a recording: written by us, from a pipe that rerun writes into.

When a write fails (disk full, stick pulled out), rerun 0.41's own file sink ends its thread, and a flush that is
waiting, the next disconnect and the exit of the process can then wait for ever. Behind a pipe rerun never sees a
failing disk: the error is an OSError here, and what rerun still writes is thrown away.
"""

import fcntl
import os
import select
import struct
import termios
import threading
import time
from pathlib import Path

_CHUNK_BYTES = 1 << 20
_POLL_S = 0.005


class FileSink:
    """A file that takes what is written to `pipe_path`, until every writer has closed it.

    Raises:
        OSError: if the file cannot be opened for writing.
    """

    def __init__(self, path: Path):
        self._file = open(path, "wb", buffering=0)
        self._read_end, self._write_end = os.pipe()
        self.error: str | None = None
        self.bytes_written = 0
        self._in_hand = threading.Lock()        # held from before a read until it is written
        self._thread = threading.Thread(target=self._pump, name="recording file", daemon=True)
        self._thread.start()

    @property
    def pipe_path(self) -> str:
        """What rerun is to open, before `opened()`."""
        return f"/dev/fd/{self._write_end}"

    def opened(self) -> None:
        """Leave rerun's own handle as the pipe's only writer, so that its closing ends the file."""
        os.close(self._write_end)

    def drain(self, timeout_s: float) -> bool:
        """Wait until all that rerun has written so far is in the file; False if it is not after `timeout_s` seconds."""
        give_up_s = time.monotonic() + timeout_s
        while (left_s := give_up_s - time.monotonic()) > 0:
            if self._in_hand.acquire(timeout=left_s):
                try:
                    if not _bytes_in(self._read_end):
                        return True
                finally:
                    self._in_hand.release()
            time.sleep(_POLL_S)
        return False

    def wait(self) -> None:
        """Wait until every writer has closed the pipe and all of it is in the file."""
        self._thread.join()

    def _pump(self) -> None:
        readable = select.poll()
        readable.register(self._read_end, select.POLLIN)
        with open(self._read_end, "rb", buffering=0) as pipe, self._file:
            while readable.poll() and self._pass_on(pipe):
                pass

    def _pass_on(self, pipe) -> bool:
        with self._in_hand:
            data = pipe.read(_CHUNK_BYTES)
            if data and self.error is None:
                self._write(data)
            return bool(data)

    def _write(self, data: bytes) -> None:
        try:
            rest = memoryview(data)
            while len(rest):
                rest = rest[self._file.write(rest):]
            self.bytes_written += len(data)
        except OSError as e:
            self.error = e.strerror or str(e)


def _bytes_in(pipe: int) -> int:
    return struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)))[0]
