"""RecordingWriter: takes frames without ever blocking or raising, and writes them to .rrd files from its own thread."""

import atexit
import os
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import layout
from srt3d_ros.recording.file_part import TICK_S, FilePart
from srt3d_ros.recording.frame_log import FrameLog, Style
from srt3d_ros.recording.jobs import Job, Jobs
from srt3d_ros.recording.live import LiveServer
from srt3d_ros.recording.parts import PartNames, Split

FLUSH_PERIOD_S = TICK_S     # without a flush, large clouds keep small scalars from being written at all
RETRY_S, MOST_RETRY_S = 1.0, 30.0       # after a file could not be written; each time twice as long
ROOM_BYTES = 16_000_000     # free on a disk that was full, before a new file is begun on it
_NOTHING = Job(lambda: None)
_TYPES = {"row": np.uint16, "col": np.uint16, "surface": np.uint8}      # of columns that are not float32


class RecordingWriter:
    """Records clouds, images, scalars and log lines on the timelines `stamp` and `frame`.

    The log_… methods copy their arrays, queue them and return; they may be called from any thread. When the disk
    cannot follow, the oldest waiting clouds and images are dropped and counted in `dropped`; the rest is kept.

    A file that cannot be opened or written is reported once, by `error` (one line, None while all is well) and
    `on_error`. What waits then, and what comes, is not recorded; clouds and images are counted. Now and then a new file
    is tried: once one can be written, `error` is None again and `on_recovery` is called.

    Args:
        path: the .rrd file, an existing one is replaced; with a split and without `names`, what PartNames makes of it.
        sensor: its geometry sets the axes, the size of the points and the precision of the depth image.
        application_id: the viewer keeps one layout per application.
        properties: what is told of the recording, {"run": {…}, …}: numbers, texts, lists of them.
        names: of the files after the first.
        images: paths of the images that will be logged, for the layout that it opens with.
        style: how clouds and images are recorded.
        split: when the next file begins.
        live: (port, memory in MB) where viewers can watch, or None; InvalidInput if the port is taken.
        queue_mb: of clouds and images that may wait.
        on_error, on_recovery: called with the line in `error`, and with the new file's path; from the writer's thread,
            or from here if the first file does not open.
    """

    def __init__(self, path, sensor: SensorModel | None, application_id: str = layout.APPLICATION_ID,
                 properties: Mapping[str, Mapping] | None = None, *, names: PartNames | None = None,
                 images: tuple[str, ...] = (layout.DEPTH,), style: Style = Style(), split: Split = Split(),
                 live: tuple[int, int] | None = None, queue_mb: float = 32.0,
                 on_error: Callable[[str], None] = lambda line: None,
                 on_recovery: Callable[[Path], None] = lambda path: None):
        self.error: str | None = None
        self.parts = 0                      # files begun
        self._on_error, self._on_recovery = on_error, on_recovery
        self._ids = application_id, str(uuid.uuid4())
        self._live = LiveServer(*live, *self._ids) if live else None
        self._log = FrameLog(sensor, properties or {}, images, style)
        if self._live is not None:
            self._log.begin(self._live.stream)
        self._split = split
        self._names = names or PartNames(Path(path), numbered=bool(split))
        self.path = Path(path) if names else self._names.next()     # of the newest file
        self._part: FilePart | None = None
        self._retry_s, self._retry_at_s = RETRY_S, 0.0
        self._jobs = Jobs(round(queue_mb * 1e6))
        try:
            self._begin_part()
        except OSError as e:
            self._fail(e)
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()
        # Before rerun's own exit handler, which can deadlock with a thread that still logs.
        atexit.register(self.close)

    @property
    def dropped(self) -> int:
        """Clouds and images that were logged and are not recorded."""
        return self._jobs.dropped

    def log_cloud(self, stamp_ns: int, frame_index: int, xyz: np.ndarray, intensity: np.ndarray, **more) -> None:
        """A cloud: `xyz` [N, 3] in metres, `intensity` [N] in photons, and of depth_std in metres, row, col and surface
        what there is.
        """
        # Copies: rerun reads the arrays later, when the caller may have filled them with the next frame.
        columns = {name: np.array(values, _TYPES.get(name, np.float32), order="C")
                   for name, values in {"xyz": xyz, "intensity": intensity, **more}.items()}
        self._put(lambda: self._log.cloud(stamp_ns, frame_index, columns), *columns.values())

    def log_depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """A depth image [rows, cols] in metres, NaN = none; kept in whole millimetres if the sensor sees < 65 m."""
        depth_m = np.array(depth_m, np.float32, order="C")
        self._put(lambda: self._log.depth(stamp_ns, frame_index, depth_m), depth_m)

    def log_image(self, path: str, stamp_ns: int, frame_index: int, photons: np.ndarray) -> None:
        """An image [rows, cols] in photons, integers, or NaN = none; `path` is one of layout.IMAGES."""
        whole = np.asarray(photons).dtype.kind in "iu"
        photons = np.array(photons, np.uint32 if whole else np.float32, order="C")
        self._put(lambda: self._log.image(path, stamp_ns, frame_index, photons), photons)

    def log_scalars(self, stamp_ns: int, values: Mapping[str, float], frame_index: int | None = None) -> None:
        """One value for each of several time series, units in their names: {"latency_ms": 35.1, "points": 19_871}."""
        values = dict(values)
        self._put(lambda: self._log.scalars(stamp_ns, frame_index, values))

    def log_line(self, stamp_ns: int, text: str, level: int = 20, frame_index: int | None = None) -> None:
        """A line of a node's log; the level as in rcl_interfaces/Log."""
        self._put(lambda: self._log.line(stamp_ns, frame_index, text, level))

    def tell(self, name: str, facts: Mapping) -> None:
        """Set facts of one of the recording's properties."""
        facts = dict(facts)
        self._put(lambda: self._log.tell(name, facts))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until all logged before is in the file; False if it is not after `timeout_s` seconds."""
        done = threading.Event()
        self._put(lambda: self._flush() and done.set())
        give_up_s = time.monotonic() + timeout_s
        while not done.wait(0.02) and self.error is None and self._thread.is_alive() and time.monotonic() < give_up_s:
            pass
        return done.is_set()

    def close(self, timeout_s: float = 30.0) -> None:
        """Write what waits and finish the file; it has failed if that takes over `timeout_s` seconds. Idempotent."""
        self._jobs.close()
        self._thread.join(timeout_s)
        atexit.unregister(self.close)
        if self._thread.is_alive():
            self._fail(TimeoutError(f"not finished within {timeout_s:g} s"))

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _put(self, write: Callable[[], None], *arrays: np.ndarray) -> None:
        self._jobs.put(Job(write, sum(max(array.nbytes, 1) for array in arrays)))

    # ---- From here on in the writer's thread

    def _run(self) -> None:
        flushed_s = time.monotonic()
        while not self._jobs.at_end:
            job = self._jobs.take(FLUSH_PERIOD_S) or _NOTHING
            try:
                self._follow_files()
                job.write()
                if self._part is None:
                    self._jobs.count_dropped(job)
                else:
                    self._part.check()
                if time.monotonic() - flushed_s > FLUSH_PERIOD_S:
                    self._flush()
                    flushed_s = time.monotonic()
            except Exception as e:      # whatever it is, the caller goes on without a recording
                self._jobs.count_dropped(job)
                self._fail(e)
        self._finish()

    def _flush(self) -> bool:
        """Whether all logged so far is in the file."""
        if self._part is not None:
            self._part.flush()
        return self._part is not None

    def _follow_files(self) -> None:
        """Begin the next file when it is time, or when one is to be tried again."""
        now_s = time.monotonic()
        if self._part is None:
            if now_s >= self._retry_at_s:
                self._try_again()
        elif self._split.due(self._part.bytes_written, now_s - self._begun_s):
            self._end_part()
            self.path = self._names.next()
            self._begin_part()

    def _begin_part(self) -> None:
        part = FilePart(self.path, *self._ids)
        self._part, self._begun_s = part, time.monotonic()
        self.parts += 1
        self._log.tell(layout.RUN, {"part": self.parts})
        self._log.begin(part.stream)

    def _end_part(self) -> None:
        if self._part is not None:
            self._log.end(self._part.stream)
            part, self._part = self._part, None
            part.close()

    def _finish(self) -> None:
        try:
            self._end_part()
        except Exception as e:
            self._fail(e)
        if self._live is not None:
            self._log.end(self._live.stream)
            self._live.close()

    # ---- Files that cannot be written

    def _fail(self, error: Exception) -> None:
        """Give the file up, say so once, try again later."""
        if self._part is not None:
            self._log.end(self._part.stream)
            # A disk that hangs would hold up this thread, and with it those who watch.
            threading.Thread(target=self._part.give_up, daemon=True).start()
            self._part = None
        self._retry_at_s = time.monotonic() + self._retry_s
        self._retry_s = min(2 * self._retry_s, MOST_RETRY_S)
        if self.error is None:
            self.error = f"recording {self.path}: {one_line(error)}"
            self._on_error(self.error)

    def _try_again(self) -> None:
        """Begin a new file, if there is room for more than its beginning."""
        room = os.statvfs(self.path.parent)
        if room.f_bavail * room.f_frsize < ROOM_BYTES:
            raise OSError("the disk is still full")
        if self.path.exists():
            self.path = self._names.next()
        self._begin_part()
        try:
            self._part.flush()
        except OSError:
            self.path.unlink(missing_ok=True)
            self.parts -= 1
            raise
        self.error, self._retry_s = None, RETRY_S
        self._on_recovery(self.path)


def one_line(error: Exception) -> str:
    """What an exception says, without line breaks and without the errno of an OSError."""
    return " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())
