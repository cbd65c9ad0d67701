"""ToA of time-tagged events that have the laser's pulses among them."""

from collections.abc import Iterable

import numpy as np

from srt3d_ros.errors import require

PULSES = 2**17              # that a period is measured on


def laser_period(pulses: Iterable[np.ndarray], divider: int = 1) -> float:
    """The laser's period in ticks, from the times of its pulses, of which every `divider`-th was recorded.

    Args:
        pulses: int64, of the chunks of a recording.
    """
    seen = np.zeros(0, np.int64)
    for part in pulses:
        seen = np.append(seen, part)
        if len(seen) > PULSES:
            break
    require(len(seen) > 1, "sync channel", f"{len(seen)} events", "the laser's pulses, to count ToA from")
    return max(float(np.median(np.diff(seen))) / max(divider, 1), 1.0)


class FromSync:
    """ToA since the newest pulse before each event, modulo the laser's period; follows a recording chunk by chunk.

    Args:
        period, bin_ticks: the laser's period and the width of a bin, ticks.
    """

    def __init__(self, period: float, bin_ticks: float):
        self._period, self._bin_ticks, self._pulse = period, bin_ticks, -1

    def __call__(self, time: np.ndarray, is_pulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ToA in bins, int64 [N], and for which events they are known, bool [N]: not before the first pulse."""
        newest = np.append(self._pulse, time[is_pulse])[np.cumsum(is_pulse)]
        self._pulse = int(newest[-1]) if len(newest) else self._pulse
        return ((time - newest) % self._period / self._bin_ticks).astype(np.int64), newest >= 0
