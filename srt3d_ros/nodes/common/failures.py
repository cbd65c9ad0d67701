"""Failures: what frames and callbacks raise, logged and counted."""

import traceback

from rclpy.impl.rcutils_logger import RcutilsLogger

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.common.diagnostics import Diagnostics
from srt3d_ros.nodes.common.worker import Dropped

LOG_EVERY_S = 2.0       # at most, the same line


class Failures:
    """Logs each failure by its kind, and counts it in the diagnostics. rclpy limits the lines by their source line."""

    def __init__(self, log: RcutilsLogger, diagnostics: Diagnostics):
        self._log, self._diagnostics = log, diagnostics
        self._raised_at: set[tuple] = set()     # places whose traceback has been logged

    def add(self, error: Exception, frames: int) -> None:
        """Log an error, and count it and the frames that it cost."""
        if isinstance(error, Dropped):
            self._diagnostics.drop(error.cause, frames)
            self._log.warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
        elif not isinstance(error, InvalidInput):
            self._add_bug(error, frames)
        elif frames:
            self._diagnostics.error(str(error), counted=False)
            self._diagnostics.drop("malformed", frames)
            self._log.warning(f"frame dropped: {error}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self._diagnostics.error(str(error))
            self._log.error(str(error), throttle_duration_sec=LOG_EVERY_S)

    def _add_bug(self, error: Exception, frames: int) -> None:
        """Count and log a bug of this package: its traceback once, then a line each time."""
        if frames:
            self._diagnostics.drop("internal", frames)
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        self._diagnostics.internal(text)
        raised_at = tuple((part.filename, part.lineno) for part in traceback.extract_tb(error.__traceback__))
        if raised_at in self._raised_at:
            self._log.error(f"again: {text}", throttle_duration_sec=LOG_EVERY_S)
        else:
            self._raised_at.add(raised_at)
            self._log.error("".join(traceback.format_exception(error)).rstrip())
