"""Read a recording back, without a viewer: clouds, depth images, time series, properties."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.recording import layout

_ROW_ID = "rerun.controls.RowId"


@dataclass(frozen=True, eq=False)
class CloudFrame:
    """A recorded cloud.

    Args:
        stamp_ns, frame_index: where it is on the two timelines.
        xyz: float32 [N, 3], metres.
        intensity: float32 [N], photons.
        colour: uint32 [N], 0xRRGGBBAA, as shown.
    """

    stamp_ns: int
    frame_index: int
    xyz: np.ndarray
    intensity: np.ndarray
    colour: np.ndarray


@dataclass(frozen=True, eq=False)
class Series:
    """A recorded time series: int64 [N] stamps in nanoseconds, in order, and float64 [N] values."""

    stamp_ns: np.ndarray
    values: np.ndarray


class RecordingReader:
    """An .rrd file written by RecordingWriter.

    Args:
        path: the file; it need not be finished, but must not end in the middle of a chunk.

    Raises:
        InvalidInput: if there is no such file, it is no recording, or it is cut off.
    """

    def __init__(self, path):
        self.path = Path(path)
        require(self.path.is_file(), "recording", str(path), "an .rrd file that exists")
        try:
            with warnings.catch_warnings():     # rerun warns of a missing footer; `is_finished` tells
                warnings.simplefilter("ignore")
                self._reader = RrdReader(self.path)
            entries = self._reader.recordings()
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None
        require(len(entries) > 0, "recording", str(path), "an .rrd file that holds a recording")
        self.application_id, self.recording_id = entries[0].application_id, entries[0].recording_id

    def is_finished(self) -> bool:
        """True if the file was closed: its footer is there."""
        try:
            self._reader.store()
        except (RuntimeError, ValueError):
            return False
        return True

    def clouds(self) -> Iterator[CloudFrame]:
        """The clouds, in the order they were logged in."""
        for chunk in self._chunks(layout.POINTS):
            stamps, frames, xyz, intensity, colour = self._columns(
                chunk, layout.STAMP, layout.FRAME, "Points3D:positions", layout.INTENSITY, "Points3D:colors")
            for k in range(chunk.num_rows):
                yield CloudFrame(int(stamps[k]), int(frames[k]), _array(xyz[k]).reshape(-1, 3),
                                 _array(intensity[k]), _array(colour[k]))

    def depth_images(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """(stamp_ns, frame_index, float32 [rows, cols] in metres, NaN = none), in the order they were logged in."""
        for chunk in self._chunks(layout.DEPTH):
            stamps, frames, buffers, formats, meters = self._columns(
                chunk, layout.STAMP, layout.FRAME, "DepthImage:buffer", "DepthImage:format", "DepthImage:meter")
            for k in range(chunk.num_rows):
                image, units_per_m = formats[k].as_py()[0], _array(meters[k])[0]
                shape = image["height"], image["width"]
                yield int(stamps[k]), int(frames[k]), layout.metres(_array(buffers[k]), shape, units_per_m)

    def series(self) -> dict[str, Series]:
        """Every time series in the order of its stamps, by the name it was logged under."""
        found: dict[str, list] = {}
        for chunk in self._chunks(f"{layout.METRICS}/**"):
            stamps, values = self._columns(chunk, layout.STAMP, "Scalars:scalars")
            name = chunk.entity_path.removeprefix(f"{layout.METRICS}/")
            found.setdefault(name, []).append((stamps, values.flatten().to_numpy()))
        return {name: _in_order(*(np.concatenate(part) for part in zip(*parts))) for name, parts in found.items()}

    def properties(self) -> dict[str, dict]:
        """What was told of run and sensor: {"run": {…}, "sensor": {…}}; arrays where there are several values."""
        found: dict[str, dict] = {}
        for chunk in self._chunks(f"{layout.PROPERTIES}/**", static=True):
            batch, name = chunk.to_record_batch(), chunk.entity_path.removeprefix(f"{layout.PROPERTIES}/")
            for field in batch.schema.names:
                if name in (layout.RUN, layout.SENSOR) and field != _ROW_ID:
                    found.setdefault(name, {})[field] = _value(batch.column(field)[0])
        return found

    def _chunks(self, content: str, static: bool = False) -> Iterator[Chunk]:
        try:
            yield from self._reader.stream().filter(content=content, is_static=static)
        except RuntimeError as e:
            raise self._unreadable(e) from None

    def _columns(self, chunk: Chunk, *names: str) -> list:
        """Columns of a chunk: the times as int64 [rows], everything else as Arrow lists, one for each row."""
        batch = chunk.to_record_batch()
        missing = [name for name in names if name not in batch.schema.names]
        require(not missing, "recording", str(self.path), f"{chunk.entity_path} with {missing and missing[0]}")
        columns = (batch.column(name) for name in names)
        return [column.cast(pa.int64()).to_numpy() if name in (layout.STAMP, layout.FRAME) else column
                for name, column in zip(names, columns)]

    def _unreadable(self, error: Exception) -> InvalidInput:
        why = " ".join(str(error).removeprefix(f"Failed to read RRD file at {self.path}: ").split())
        return InvalidInput("recording", str(self.path), f"a whole .rrd file ({why})")


def _array(item: pa.Scalar) -> np.ndarray:
    """The values of one row of one column, flat."""
    values = item.values
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    return values.to_numpy(zero_copy_only=False)


def _value(item: pa.Scalar):
    values = item.as_py()
    return values[0] if len(values) == 1 else np.array(values)


def _in_order(stamp_ns: np.ndarray, values: np.ndarray) -> Series:
    order = np.argsort(stamp_ns, kind="stable")
    return Series(stamp_ns[order], values[order])
