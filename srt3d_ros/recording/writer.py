"""RecordingWriter: queue frames without blocking or raising; a thread of its own writes them to .rrd files."""

import atexit
import os
import shutil
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.new_files import free
from srt3d_ros.recording import rerun_streams, schema
from srt3d_ros.recording.frame_log import FrameLog
from srt3d_ros.recording.write_queue import Write, WriteQueue

FLUSH_PERIOD_S = 0.4        # without a flush, large clouds keep small scalars from being written at all
FLUSH_TIMEOUT_S = 20.0      # after which a disk is taken to hang
END_TIMEOUT_S = 2.0         # for a file that could not be written
LEAST_FREE_BYTES = 500_000_000      # of the disk, below which a recording ends: its end, and other programs, need room
_LEVELS = {10: "DEBUG", 20: "INFO", 30: "WARN", 40: "ERROR", 50: "CRITICAL"}      # of rcl_interfaces/Log
_TYPES = {"row": np.uint16, "col": np.uint16, "surface": np.uint8}      # of columns that are not float32


class RecordingWriter:
    """Records clouds, images, scalars and log lines on the timelines `stamp` and `frame`.

    The log_… methods copy their arrays, queue them and return; any thread may call them. When the disk is too slow,
    the oldest waiting clouds and images are dropped and counted in `dropped`; scalars and lines are kept.

    When a file cannot be written, or the disk has less than 500 MB left, the recording ends: `error` becomes a line of
    text (it is None otherwise), `on_error` is called once, and what is logged afterwards is dropped.

    Args:
        path: the .rrd file; where there is one already, the first of NAME_2.rrd, NAME_3.rrd, … that is free.
        sensor: sets the axes and the size of the points.
        properties: of the recording, {"run": {…}, …}: numbers, strings, lists of them.
        images: entity paths of the images that will be logged, for the blueprint.
        queue_mb: of clouds and images that may wait.
        on_error: called with the line in `error`, from the writing thread, or from here if the file does not open.
    """

    def __init__(self, path, sensor: SensorModel | None, properties: Mapping[str, Mapping] | None = None, *,
                 images: tuple[str, ...] = (schema.DEPTH,), queue_mb: float = 32.0,
                 on_error: Callable[[str], None] = lambda line: None):
        self.error: str | None = None
        self.path = free(Path(path))
        self._on_error = on_error
        self._stream = rr.RecordingStream(schema.APPLICATION_ID, recording_id=str(uuid.uuid4()))
        self._log = FrameLog(self._stream, sensor, properties or {}, images)
        self._queue = WriteQueue(round(queue_mb * 1e6))
        try:
            self._create_file()
        except Exception as error:
            self._fail(error)
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

    def log_image(self, path: str, stamp_ns: int, frame_index: int, image: np.ndarray) -> None:
        """Log an image [rows, cols], NaN = none: schema.DEPTH in metres, or one of schema.IMAGES in photons."""
        whole = np.asarray(image).dtype.kind in "iu"
        image = np.array(image, np.uint32 if whole else np.float32, order="C")
        self._put(lambda: self._log.image(path, stamp_ns, frame_index, image), image)

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
        self._put(lambda: schema.log_properties(self._stream, name, facts))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything logged before is in the file; False after `timeout_s` seconds, or after an error."""
        done = threading.Event()
        self._put(lambda: (self._flush(), done.set()))
        deadline_s = time.monotonic() + timeout_s
        while not done.wait(0.02) and self.error is None and time.monotonic() < deadline_s:
            pass
        return done.is_set()

    def close(self, timeout_s: float = 30.0) -> None:
        """Write what waits and finish the file; `error` is set if that takes over `timeout_s` seconds. Idempotent.

        If the disk hangs, this process ends with exit code 1 when it ends: rerun would wait for the disk for ever.
        """
        self._queue.close()
        self._thread.join(timeout_s if self.error is None else END_TIMEOUT_S)
        atexit.unregister(self.close)
        if self._thread.is_alive():
            self._fail(TimeoutError(f"not finished within {timeout_s:g} s"))
            atexit.register(_end_process)       # what is registered last is called first, before rerun's handler

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _put(self, write: Callable[[], None], *arrays: np.ndarray) -> None:
        self._queue.put(Write(write, sum(max(array.nbytes, 1) for array in arrays)))

    # ---- In the writing thread

    def _run(self) -> None:
        try:
            if self.error is None:
                self._stream.save(self.path)
                self._log.begin()
            flushed_s = time.monotonic()
            while not self._queue.at_end:
                if write := self._queue.take(FLUSH_PERIOD_S):
                    write.run()
                if time.monotonic() - flushed_s > FLUSH_PERIOD_S:
                    self._flush()
                    flushed_s = time.monotonic()
            if self.error is None:
                self._log.end()
                self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        except Exception as error:      # the caller must go on without a recording, whatever failed
            self._fail(error)
        self._stream.disconnect()       # the file gets its footer
        self._stream = self._log = None
        rerun_streams.free_ended()

    def _create_file(self) -> None:
        """Create the file: where that fails, rerun would wait for ever. Its header is written over the byte."""
        self._check_disk()
        with self.path.open("xb") as file:
            file.write(b"R")

    def _flush(self) -> None:
        """Put everything logged so far into the file, and see whether the disk has room for more."""
        self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        self._check_disk()

    def _check_disk(self) -> None:
        left = shutil.disk_usage(self.path.parent).free
        if left < LEAST_FREE_BYTES:
            raise OSError(f"stopped, as the disk has only {left / 1e6:.0f} MB left")

    def _fail(self, error: Exception) -> None:
        """Report the first error, drop what waits, and accept nothing more."""
        self._queue.close(drop=True)
        if self.error is None:
            self.error = f"recording {self.path}: {one_line(error)}"
            self._on_error(self.error)


def _end_process() -> None:
    """End this process without the exit handlers that were registered before."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1)


def one_line(error: Exception) -> str:
    """The message of an exception, without line breaks and without the errno of an OSError."""
    return " ".join(str(getattr(error, "strerror", None) or error or type(error).__name__).split())
