"""RecordingWriter: queue frames without blocking or raising; a thread of its own writes them to .rrd files."""

import atexit
import os
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import live as live_server
from srt3d_ros.recording import rerun_streams, schema
from srt3d_ros.recording.frame_log import FrameLog, Style
from srt3d_ros.recording.parts import PartNames, Split
from srt3d_ros.recording.rrd_file import TICK_S, RrdFile
from srt3d_ros.recording.write_queue import Write, WriteQueue

FLUSH_PERIOD_S = TICK_S     # without a flush, large clouds keep small scalars from being written at all
RETRY_S, MOST_RETRY_S = 1.0, 30.0       # after a file could not be written; doubled each time
ROOM_BYTES = 16_000_000     # free space on a disk that was full, before a new file is begun on it
_NO_WRITE = Write(lambda: None)
_LEVELS = {10: "DEBUG", 20: "INFO", 30: "WARN", 40: "ERROR", 50: "CRITICAL"}      # of rcl_interfaces/Log
_TYPES = {"row": np.uint16, "col": np.uint16, "surface": np.uint8}      # of columns that are not float32


class RecordingWriter:
    """Records clouds, images, scalars and log lines on the timelines `stamp` and `frame`.

    The log_… methods copy their arrays, queue them and return; any thread may call them. When the disk is too slow,
    the oldest waiting clouds and images are dropped and counted in `dropped`; scalars and lines are kept.

    When a file cannot be opened or written, `error` becomes a line of text (it is None otherwise) and `on_error` is
    called once. Until a new file can be written, everything is dropped, and clouds and images are counted. Then
    `error` is None again and `on_recovery` is called.

    Args:
        path: the .rrd file, replaced if it exists; with a split and without `names`, what PartNames makes of it.
        sensor: sets the axes, the size of the points and the precision of the depth image.
        properties: of the recording, {"run": {…}, …}: numbers, strings, lists of them.
        names: of the files after the first.
        images: entity paths of the images that will be logged, for the blueprint.
        style: how clouds and images are recorded.
        split: when the next file begins.
        live: (port, memory in MB) for viewers, or None; InvalidInput if the port is taken.
        queue_mb: of clouds and images that may wait.
        on_error, on_recovery: called with the line in `error`, and with the new file's path; from the writing thread,
            or from here if the first file does not open.
    """

    def __init__(self, path, sensor: SensorModel | None, properties: Mapping[str, Mapping] | None = None, *,
                 names: PartNames | None = None, images: tuple[str, ...] = (schema.DEPTH,), style: Style = Style(),
                 split: Split = Split(), live: tuple[int, int] | None = None, queue_mb: float = 32.0,
                 on_error: Callable[[str], None] = lambda line: None,
                 on_recovery: Callable[[Path], None] = lambda path: None):
        self.error: str | None = None
        self.parts = 0                      # files begun
        self._on_error, self._on_recovery = on_error, on_recovery
        self._ids = schema.APPLICATION_ID, str(uuid.uuid4())
        self._live = live_server.serve(*live, *self._ids) if live else None
        self._log = FrameLog(sensor, properties or {}, images, style)
        if self._live is not None:
            self._log.begin(self._live)
        self._split = split
        self._names = names or PartNames(Path(path), numbered=bool(split))
        self.path = Path(path) if names else self._names.next()     # of the newest file
        self._file: RrdFile | None = None
        self._retry_s, self._retry_at_s = RETRY_S, 0.0
        self._queue = WriteQueue(round(queue_mb * 1e6))
        try:
            self._begin_file()
        except OSError as e:
            self._fail(e)
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()
        # Before rerun's own exit handler, which can deadlock with a thread that still logs.
        atexit.register(self.close)

    @property
    def dropped(self) -> int:
        """Number of clouds and images that were logged and are not recorded."""
        return self._queue.dropped

    def log_cloud(self, stamp_ns: int, frame_index: int, xyz: np.ndarray, intensity: np.ndarray, **more) -> None:
        """Log a cloud: `xyz` [N, 3] in metres, `intensity` [N] in photons; `more`: schema.OF_FULL_CLOUDS."""
        # Copies: rerun reads the arrays later, when the caller may have filled them with the next frame.
        columns = {name: np.array(values, _TYPES.get(name, np.float32), order="C")
                   for name, values in {"xyz": xyz, "intensity": intensity, **more}.items()}
        self._put(lambda: self._log.cloud(stamp_ns, frame_index, columns), *columns.values())

    def log_depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """Log a depth image [rows, cols] in metres, NaN = none; rounded to millimetres if the sensor sees < 65 m."""
        depth_m = np.array(depth_m, np.float32, order="C")
        self._put(lambda: self._log.depth(stamp_ns, frame_index, depth_m), depth_m)

    def log_image(self, path: str, stamp_ns: int, frame_index: int, photons: np.ndarray) -> None:
        """Log an image [rows, cols] in photons, integers, or NaN = none; `path` is one of schema.IMAGES."""
        whole = np.asarray(photons).dtype.kind in "iu"
        photons = np.array(photons, np.uint32 if whole else np.float32, order="C")
        self._put(lambda: self._log.image(path, stamp_ns, frame_index, photons), photons)

    def log_scalars(self, stamp_ns: int, values: Mapping[str, float], frame_index: int | None = None) -> None:
        """Log one value for each of several time series: {"latency_ms": 35.1, "points": 19_871}."""
        scalars = {schema.metric_path(name): [rr.Scalars(float(value))] for name, value in values.items()
                   if value is not None}
        self._put(lambda: self._log.log(stamp_ns, frame_index, scalars))

    def log_line(self, stamp_ns: int, text: str, level: int = 20, frame_index: int | None = None) -> None:
        """Log a line of a node's log; the level as in rcl_interfaces/Log."""
        line = rr.TextLog(text, level=_LEVELS.get(level, "INFO"))
        self._put(lambda: self._log.log(stamp_ns, frame_index, {schema.LOG: [line]}))

    def set_properties(self, name: str, facts: Mapping) -> None:
        """Set facts of one of the recording's properties."""
        facts = dict(facts)
        self._put(lambda: self._log.set_properties(name, facts))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything logged before is in the file; False after `timeout_s` seconds."""
        done = threading.Event()
        self._put(lambda: self._flush() and done.set())
        deadline_s = time.monotonic() + timeout_s
        while not done.wait(0.02) and self.error is None and self._thread.is_alive() and time.monotonic() < deadline_s:
            pass
        return done.is_set()

    def close(self, timeout_s: float = 30.0) -> None:
        """Write what waits and finish the file; `error` is set if that takes over `timeout_s` seconds. Idempotent."""
        self._queue.close()
        self._thread.join(timeout_s)
        atexit.unregister(self.close)
        if self._thread.is_alive():
            self._fail(TimeoutError(f"not finished within {timeout_s:g} s"))

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _put(self, write: Callable[[], None], *arrays: np.ndarray) -> None:
        self._queue.put(Write(write, sum(max(array.nbytes, 1) for array in arrays)))

    # ---- In the writing thread

    def _run(self) -> None:
        flushed_s = time.monotonic()
        while not self._queue.at_end:
            write = self._queue.take(FLUSH_PERIOD_S) or _NO_WRITE
            try:
                self._switch_files()
                write.run()
                if self._file is None:
                    self._queue.count_dropped(write)
                else:
                    self._file.check()
                if time.monotonic() - flushed_s > FLUSH_PERIOD_S:
                    self._flush()
                    flushed_s = time.monotonic()
            except Exception as e:      # the caller must go on without a recording, whatever failed
                self._queue.count_dropped(write)
                self._fail(e)
        self._finish()

    def _flush(self) -> bool:
        """Put everything logged so far into the file; False without a file."""
        if self._file is not None:
            self._file.flush()
        return self._file is not None

    def _switch_files(self) -> None:
        """Begin the next file when the split is due, or when a failed one is due for another try."""
        now_s = time.monotonic()
        if self._file is None:
            if now_s >= self._retry_at_s:
                self._try_new_file()
        elif self._split.due(self._file.bytes_written, now_s - self._begun_s):
            self._end_file()
            self.path = self._names.next()
            self._begin_file()

    def _begin_file(self) -> None:
        file = RrdFile(self.path, *self._ids)
        self._file, self._begun_s = file, time.monotonic()
        self.parts += 1
        self._log.set_properties(schema.RUN, {"part": self.parts})
        self._log.begin(file.stream)

    def _end_file(self) -> None:
        if self._file is not None:
            self._log.end(self._file.stream)
            file, self._file = self._file, None
            file.close()

    def _finish(self) -> None:
        try:
            self._end_file()
        except Exception as e:
            self._fail(e)
        if self._live is not None:
            self._log.end(self._live)
            self._live.disconnect()
            self._live = None
            rerun_streams.free_ended()

    # ---- Files that cannot be written

    def _fail(self, error: Exception) -> None:
        """Abandon the file, report the error once, and schedule another try."""
        if self._file is not None:
            self._log.end(self._file.stream)
            # In a thread: a disk that hangs would block this one, and with it the live server.
            threading.Thread(target=self._file.abandon, daemon=True).start()
            self._file = None
        self._retry_at_s = time.monotonic() + self._retry_s
        self._retry_s = min(2 * self._retry_s, MOST_RETRY_S)
        if self.error is None:
            self.error = f"recording {self.path}: {one_line(error)}"
            self._on_error(self.error)

    def _try_new_file(self) -> None:
        """Begin a new file if the disk has room for more than its beginning."""
        room = os.statvfs(self.path.parent)
        if room.f_bavail * room.f_frsize < ROOM_BYTES:
            raise OSError("the disk is still full")
        if self.path.exists():
            self.path = self._names.next()
        self._begin_file()
        try:
            self._file.flush()
        except OSError:
            self.path.unlink(missing_ok=True)
            self.parts -= 1
            raise
        self.error, self._retry_s = None, RETRY_S
        self._on_recovery(self.path)


def one_line(error: Exception) -> str:
    """The message of an exception, without line breaks and without the errno of an OSError."""
    return " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())
