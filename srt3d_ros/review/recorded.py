"""A recording to review: its clouds have times, gaps and latencies."""

from pathlib import Path

import numpy as np

from srt3d_ros.errors import require
from srt3d_ros.messages import sensor_message
from srt3d_ros.recording import entities
from srt3d_ros.recording.reader import RecordingReader, Series

GAP_PERIODS = 1.5           # clouds farther apart have a gap between them
_LATENCIES = {"total": "latency_ms", "reconstruct": "latency_reconstruct_ms", "sketch": "latency_sketch_ms"}


class Recorded(RecordingReader):
    """A recording with clouds and a `sensor`, all of whose pixels have the same IRF; InvalidInput if it has none."""

    def __init__(self, path: Path):
        super().__init__(path)
        require(len(self.index) > 0, "recording", problem=f"{path} has no clouds at /points.")
        described = self.properties.get(entities.SENSOR_PROPERTY, {})
        require("description" in described, "recording", problem=f"{path} has no description of its sensor.")
        self.sensor = sensor_message.from_json(described["description"])

    @property
    def seconds(self) -> np.ndarray:
        """Time of each cloud in seconds since the first; float64 [N]."""
        return self.since_first(self.index.stamp_ns)

    def since_first(self, stamp_ns: np.ndarray) -> np.ndarray:
        """Seconds since the first cloud."""
        return (np.asarray(stamp_ns) - self.index.stamp_ns[0]) * 1e-9

    @property
    def period_s(self) -> float:
        """The median time from cloud to cloud; 0 for a single one."""
        return float(np.median(np.diff(self.seconds))) if len(self.index) > 1 else 0.0

    @property
    def gaps(self) -> list[int]:
        """Positions of the clouds after which frames are missing, that with the longest gap first."""
        steps = np.diff(self.seconds)
        order = np.argsort(-steps, kind="stable")
        return order[steps[order] > GAP_PERIODS * max(self.period_s, 1e-9)].tolist()

    def at_cloud(self, name: str, position: int) -> float:
        """A series' value at the stamp of a cloud; NaN if missing."""
        series = self.series.get(name)
        found = series.values[series.stamp_ns == self.index.stamp_ns[position]] if series else np.empty(0)
        return float(found[0]) if len(found) else np.nan

    def latencies(self) -> dict[str, Series]:
        """The latency series in milliseconds: `total`, and one for each stage."""
        return {stage: self.series[name] for stage, name in _LATENCIES.items() if name in self.series}
