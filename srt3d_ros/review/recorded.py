"""A recording without its clouds and images, in memory: the index of clouds, time series, log, properties."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Projection
from srt3d_ros.errors import require
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.recording import schema
from srt3d_ros.recording.reader import CloudIndex, LogLine, RecordingReader, Series

_LATENCIES = {"total": "latency_ms", "reconstruct": "latency_reconstruct_ms", "sketch": "latency_sketch_ms"}


@dataclass(frozen=True, eq=False)
class Recorded:
    """The contents of a recording; `reader` reads its clouds and images."""

    path: Path
    reader: RecordingReader
    index: CloudIndex
    series: dict[str, Series]
    log: list[LogLine] = field(default_factory=list)
    properties: dict[str, dict] = field(default_factory=dict)

    @classmethod
    def read(cls, path) -> "Recorded":
        """Read a recording; InvalidInput if the file is none, or has no cloud."""
        reader = RecordingReader(path)
        index = reader.cloud_index(progress=True)
        require(len(index) > 0, "recording", str(path), "a recording with clouds at /points")
        return cls(Path(path), reader, index, reader.series(), reader.log_lines(), reader.properties())

    @property
    def seconds(self) -> np.ndarray:
        """Seconds of each cloud since the first; float64 [N]."""
        return self.since_first(self.index.stamp_ns)

    def since_first(self, stamp_ns: np.ndarray) -> np.ndarray:
        """Seconds since the first cloud."""
        return (np.asarray(stamp_ns) - self.index.stamp_ns[0]) * 1e-9

    def at_clouds(self, name: str) -> np.ndarray:
        """A series' value at each cloud's stamp, float64 [N], NaN = missing."""
        stamps, values = self.index.stamp_ns, np.full(len(self.index), np.nan)
        series = self.series.get(name)
        if series is not None and len(series.stamp_ns):
            at = np.minimum(np.searchsorted(series.stamp_ns, stamps), len(series.stamp_ns) - 1)
            found = series.stamp_ns[at] == stamps
            values[found] = series.values[at[found]]
        return values

    def latencies(self) -> dict[str, Series]:
        """The series of latencies in milliseconds: `total`, and each stage's by its name."""
        return {stage: self.series[name] for stage, name in _LATENCIES.items() if name in self.series}

    @cached_property
    def sensor(self) -> SensorModel | None:
        """The sensor from the recording's properties, all pixels with the same IRF; None if it was recorded without."""
        text = self.properties.get(schema.SENSOR, {}).get("description")
        return None if text is None else sensor_message.from_json(text)

    @property
    def projection(self) -> Projection | None:
        """The sensor's projection, if the sensor is known."""
        return self.sensor.projection if self.sensor else None
