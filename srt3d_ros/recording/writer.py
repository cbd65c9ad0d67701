"""RecordingWriter: takes frames without ever blocking or raising, and writes them to an .rrd from its own thread."""

import atexit
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.recording import layout
from srt3d_ros.recording.frame_log import FrameLog

FLUSH_PERIOD_S = 1.0        # without a flush, large clouds keep small scalars from being written at all
_MOST_WAITING = 100_000     # jobs of all kinds: only scalars logged to a disk that hangs come near it


class RecordingWriter:
    """Records clouds, depth images and scalars on the timelines `stamp` and `frame`.

    The log_… methods copy their arrays, queue them and return; they may be called from any thread. When the disk
    cannot follow, the oldest waiting clouds and images are dropped and counted in `dropped`; scalars are kept. A file
    that cannot be opened or written is reported once, by `error` (one line, None while all is well) and `on_error`;
    what waits or is logged after that is dropped and counted.

    Args:
        path: the .rrd file; an existing one is overwritten.
        sensor: its geometry sets the axes, the size of the points and the precision of the depth image.
        application_id: the viewer keeps one layout per application.
        properties: facts about the run, kept as the recording's property `run`: numbers, texts, lists of them.
        queue_frames: clouds and images that may wait.
        on_error: called with the line in `error`: from the writer's thread, or from here if the file does not open.
    """

    def __init__(self, path, sensor: SensorModel | None, application_id: str = layout.APPLICATION_ID,
                 properties: dict | None = None, *, queue_frames: int = 8,
                 on_error: Callable[[str], None] | None = None):
        self.path, self.error, self.dropped = Path(path), None, 0
        self._on_error, self._queue_frames = on_error, queue_frames
        self._jobs: deque[tuple[bool, Callable[[], None]]] = deque()    # (is a frame, what to do)
        self._waiting_frames = 0
        self._wake, self._closing = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        try:
            self._log = FrameLog(self.path, sensor, application_id, properties or {})
        except OSError as e:
            self._fail(e)
        else:
            self._thread.start()
            # Before rerun's own exit handler, which can deadlock with a thread that still logs.
            atexit.register(self.close)

    def log_cloud(self, stamp_ns: int, frame_index: int, xyz: np.ndarray, intensity: np.ndarray) -> None:
        """A cloud: `xyz` [N, 3] in metres, `intensity` [N] in photons; both kept as float32."""
        # Copies: rerun reads the arrays later, when the caller may have filled them with the next frame.
        xyz, intensity = np.array(xyz, np.float32, order="C"), np.array(intensity, np.float32, order="C")
        self._put(lambda: self._log.cloud(stamp_ns, frame_index, xyz, intensity), is_frame=True)

    def log_depth(self, stamp_ns: int, frame_index: int, depth_m: np.ndarray) -> None:
        """A depth image [rows, cols] in metres, NaN = none; kept in whole millimetres if the sensor sees < 65 m."""
        depth_m = np.array(depth_m, np.float32, order="C")
        self._put(lambda: self._log.depth(stamp_ns, frame_index, depth_m), is_frame=True)

    def log_scalars(self, stamp_ns: int, values: dict[str, float], frame_index: int | None = None) -> None:
        """One value for each of several time series, units in their names: {"latency_ms": 35.1, "points": 19_871}."""
        values = dict(values)
        self._put(lambda: self._log.scalars(stamp_ns, frame_index, values))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until all logged before is in the file; False if it is not after `timeout_s` seconds."""
        done = threading.Event()
        self._put(lambda: (self._log.flush(), done.set()))
        give_up_s = time.monotonic() + timeout_s
        while not done.wait(0.02) and self._thread.is_alive() and time.monotonic() < give_up_s:
            pass
        return done.is_set()

    def close(self, timeout_s: float = 30.0) -> None:
        """Write what waits and finish the file; it has failed if that takes over `timeout_s` seconds. Idempotent."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        atexit.unregister(self.close)
        if self._thread.is_alive():
            self._fail(TimeoutError(f"not finished within {timeout_s:g} s"))

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _put(self, write: Callable[[], None], is_frame: bool = False) -> None:
        with self._wake:
            if self._closing or self.error is not None:
                self.dropped += is_frame
                return
            if len(self._jobs) >= _MOST_WAITING or is_frame and self._waiting_frames >= self._queue_frames:
                self._drop_oldest(is_frame)
            self._jobs.append((is_frame, write))
            self._waiting_frames += is_frame
            self._wake.notify()

    def _drop_oldest(self, is_frame: bool) -> None:
        for k, (frame, _) in enumerate(self._jobs):
            if frame >= is_frame:
                del self._jobs[k]
                self._waiting_frames -= frame
                self.dropped += 1
                return

    def _run(self) -> None:
        try:
            self._write_all()
            self._log.close()
        except Exception as e:      # whatever it is, the caller goes on without a recording
            self._fail(e)

    def _write_all(self) -> None:
        """Do the jobs as they come, until closed and none is left."""
        flushed_s = time.monotonic()
        while True:
            with self._wake:
                if not self._jobs and not self._closing:
                    self._wake.wait(FLUSH_PERIOD_S)
                is_frame, write = self._jobs.popleft() if self._jobs else (False, None)
                self._waiting_frames -= is_frame
            if write is not None:
                write()
            elif self._closing:
                return
            if time.monotonic() - flushed_s > FLUSH_PERIOD_S:
                self._log.flush()
                flushed_s = time.monotonic()

    def _fail(self, error: Exception) -> None:
        with self._wake:
            if self.error is not None:
                return
            self.error = f"recording {self.path}: {one_line(error)}"
            self.dropped += self._waiting_frames
            self._waiting_frames = 0
            self._jobs.clear()
        if self._on_error is not None:
            self._on_error(self.error)


def one_line(error: Exception) -> str:
    """What an exception says, without line breaks and without the errno of an OSError."""
    return " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())
