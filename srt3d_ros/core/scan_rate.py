"""ScanRate: when each pixel of a scanner looks."""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.errors import require

MAX_SCAN_S = 3600.0         # float32, of the points' `t`, still tells a quarter of a millisecond
ROUNDING_S = 1e-9           # by which the first pixel of a scan that runs backwards may miss the stamp


@dataclass(frozen=True)
class ScanRate:
    """Pixel (row, col) begins to look `start_s + row · row_period_s + col · col_period_s` after the frame's stamp.

    Args:
        row_period_s: seconds from one row to the next; negative if the scan runs from the last row to row 0.
        col_period_s: seconds from one column to the next; negative if from the last column to column 0.
        start_s: of pixel (0, 0), seconds after the stamp; needed where a period is negative.
    """

    row_period_s: float = 0.0
    col_period_s: float = 0.0
    start_s: float = 0.0

    def check(self, rows: int, cols: int) -> None:
        """Raise InvalidInput unless all pixels of a sensor of this size look after the stamp, and not all at once."""
        require(self.row_period_s != 0 or self.col_period_s != 0, "scan", "without a period",
                "row_period_s or col_period_s, seconds; none where all pixels look at once")
        first, last = self.limits_s(rows, cols)
        require(-ROUNDING_S <= first and last <= MAX_SCAN_S, "scan", f"{first:g} to {last:g} s after the stamp",
                f"0 to {MAX_SCAN_S:g} s (start_s is that of pixel (0, 0))")

    def limits_s(self, rows: int, cols: int) -> tuple[float, float]:
        """Seconds after the stamp at which the first and the last pixel begin to look."""
        spans = (rows - 1) * self.row_period_s, (cols - 1) * self.col_period_s
        first, last = (self.start_s + sum(limit(span, 0.0) for span in spans) for limit in (min, max))
        return first, last

    def times_s(self, rows: int, cols: int) -> np.ndarray:
        """Seconds after the stamp at which each pixel begins to look, float64 [rows, cols]."""
        of_rows, of_cols = np.arange(rows) * self.row_period_s, np.arange(cols) * self.col_period_s
        return np.maximum(self.start_s + of_rows[:, None] + of_cols, 0)

    def upsampled(self, factor: int) -> "ScanRate":
        """Of `factor` × `factor` finer pixels, which share the time of the pixel in whose place they are."""
        row_period_s, col_period_s = self.row_period_s / factor, self.col_period_s / factor
        later_s = max(-row_period_s, 0.0) + max(-col_period_s, 0.0)     # backwards, the first of them looks last
        return ScanRate(row_period_s, col_period_s, self.start_s + (factor - 1) * later_s)

    def cropped(self, first_row: int, first_col: int) -> "ScanRate":
        """Of the pixels from (first_row, first_col) on, by the same stamp."""
        start_s = self.start_s + first_row * self.row_period_s + first_col * self.col_period_s
        return replace(self, start_s=max(start_s, 0.0))
