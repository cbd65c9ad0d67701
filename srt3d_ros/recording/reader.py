"""Read a recording back, without a viewer: clouds, images, time series, log lines, properties."""

import warnings
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader
from tqdm import tqdm

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.recording import layout
from srt3d_ros.recording.repair import examine

_ROW_ID = "rerun.controls.RowId"
_TYPES = {6: np.uint8, 7: np.int8, 8: np.uint16, 9: np.int16, 10: np.uint32, 11: np.int32, 12: np.uint64, 13: np.int64,
          33: np.float16, 34: np.float32, 35: np.float64}      # rerun's ChannelDatatype


@dataclass(frozen=True, eq=False)
class CloudFrame:
    """A recorded cloud.

    Args:
        stamp_ns, frame_index: where it is on the two timelines.
        xyz: float32 [N, 3], metres.
        intensity: float32 [N], photons.
        colour: uint32 [N], 0xRRGGBBAA, as shown.
        depth_std_m: float32 [N], metres, or None where none were recorded.
        row, col, surface: uint16, uint16, uint8 [N], which pixel and which of its points, or None likewise.
    """

    stamp_ns: int
    frame_index: int
    xyz: np.ndarray
    intensity: np.ndarray
    colour: np.ndarray
    depth_std_m: np.ndarray | None = None
    row: np.ndarray | None = None
    col: np.ndarray | None = None
    surface: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.xyz)


@dataclass(frozen=True, eq=False)
class Series:
    """A recorded time series: int64 [N] stamps in nanoseconds, in order, and float64 [N] values."""

    stamp_ns: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class CloudIndex:
    """Which clouds there are, in the order of their stamps: int64 [N] frame indices, stamps in nanoseconds, points."""

    frame_index: np.ndarray
    stamp_ns: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True)
class LogLine:
    """A line of a node's log: its stamp (None = recorded without one), level (INFO, WARN, …) and text."""

    stamp_ns: int | None
    level: str
    text: str


class RecordingReader:
    """An .rrd file written by RecordingWriter.

    Args:
        path: the file; it need not be finished, but must not end in the middle of a chunk.

    Raises:
        InvalidInput: if there is no such file, it is no recording, a newer rerun wrote it, or it is cut off.
    """

    def __init__(self, path):
        self.path = Path(path)
        self._state = examine(path)
        require(not self._state.lost_bytes, "recording", str(path),
                "a whole .rrd file; this one is cut off, and `srt3d review` repairs it into a copy")
        try:
            with warnings.catch_warnings():     # rerun warns of a missing footer; `is_finished` tells
                warnings.simplefilter("ignore")
                self._reader = RrdReader(self.path)
            entries = self._reader.recordings()
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None
        require(len(entries) > 0, "recording", str(path), "an .rrd file that holds a recording")
        self._store = entries[0]        # rerun warns of a choice that it makes by itself
        self.application_id, self.recording_id = self._store.application_id, self._store.recording_id

    def is_finished(self) -> bool:
        """True if the file was closed: its footer is there."""
        return self._state.is_finished

    def cloud_index(self, progress: bool = False) -> CloudIndex:
        """Stamp, frame and number of points of every cloud; `progress`: with a bar if it takes longer than 2 s."""
        rows = tqdm(self._rows(layout.POINTS, layout.FRAME, layout.STAMP, "Points3D:positions"), "reading", delay=2,
                    leave=False, unit="chunk", disable=not progress)
        parts = [(frames, stamps, _lengths(xyz)) for _, frames, stamps, xyz in rows]
        frames, stamps, points = (np.concatenate(part) for part in zip(*parts)) if parts else [np.empty(0, int)] * 3
        order = np.argsort(stamps, kind="stable")
        return CloudIndex(frames[order], stamps[order], points[order])

    def clouds(self, only: Container[int] | None = None) -> Iterator[CloudFrame]:
        """The clouds, in the order they were logged in; those with a frame index in `only` if it is given."""
        for chunk, stamps, frames, xyz, intensity, colour in self._rows(
                layout.POINTS, layout.STAMP, layout.FRAME, "Points3D:positions", layout.INTENSITY, "Points3D:colors"):
            optional = [self._optional(chunk, name) for name in layout.OF_FULL_CLOUDS]
            for k in range(len(stamps)):
                if only is None or int(frames[k]) in only:
                    std, *pixel = (None if column is None or not column[k].is_valid else _array(column[k])
                                   for column in optional)
                    yield CloudFrame(int(stamps[k]), int(frames[k]), _array(xyz[k]).reshape(-1, 3),
                                     _array(intensity[k]).astype(np.float32), _array(colour[k]),
                                     None if std is None else std.astype(np.float32), *pixel)

    def depth_images(self, only: Container[int] | None = None) -> Iterator[tuple[int, int, np.ndarray]]:
        """(stamp_ns, frame_index, float32 [rows, cols] in metres, NaN = none), in the order they were logged in."""
        return self.images(layout.DEPTH, only)

    def images(self, path: str, only: Container[int] | None = None) -> Iterator[tuple[int, int, np.ndarray]]:
        """(stamp_ns, frame_index, [rows, cols]) of the images at an entity path, NaN = none; nothing without images.

        Depth images in metres, float32; those of photons as they were recorded: integers, float16 or float32.
        """
        for chunk, stamps, frames in self._rows(path, layout.STAMP, layout.FRAME):
            kind = next((kind for kind in ("DepthImage", "Image")
                         if f"{kind}:buffer" in chunk.to_record_batch().schema.names), None)
            if kind is None:
                continue
            buffers, formats = self._columns(chunk, f"{kind}:buffer", f"{kind}:format")
            meters = self._optional(chunk, "DepthImage:meter")
            for k in range(len(stamps)):
                if only is None or int(frames[k]) in only:
                    units_per_m = None if meters is None else _array(meters[k])[0]
                    yield int(stamps[k]), int(frames[k]), _image(_array(buffers[k]), formats[k].as_py()[0], units_per_m)

    def series(self) -> dict[str, Series]:
        """Every time series in the order of its stamps, by the name it was logged under."""
        found: dict[str, list] = {}
        for chunk, stamps, values in self._rows(f"{layout.METRICS}/**", layout.STAMP, "Scalars:scalars"):
            name = chunk.entity_path.removeprefix(f"{layout.METRICS}/")
            found.setdefault(name, []).append((stamps, values.flatten().to_numpy()))
        return {name: _in_order(*(np.concatenate(part) for part in zip(*parts))) for name, parts in found.items()}

    def log_lines(self) -> list[LogLine]:
        """What the nodes logged, in the order it was recorded."""
        lines = []
        for chunk, texts in self._rows(f"{layout.LOG}/**", "TextLog:text"):
            levels, stamps = (self._optional(chunk, name) for name in ("TextLog:level", layout.STAMP))
            for k in range(chunk.num_rows):
                level = levels[k].as_py() if levels is not None else None
                lines.append(LogLine(None if stamps is None else int(stamps[k]), (level or [""])[0],
                                     (texts[k].as_py() or [""])[0]))
        return lines

    def properties(self) -> dict[str, dict]:
        """What was told of run, sensor, …, last: {"run": {…}, "sensor": {…}}; arrays where there are several values."""
        latest: dict[tuple[str, str], tuple[bytes, pa.Scalar]] = {}     # told again, a fact has another row
        for chunk in self._chunks(f"{layout.PROPERTIES}/**", static=True):
            batch, name = chunk.to_record_batch(), chunk.entity_path.removeprefix(layout.PROPERTIES).strip("/")
            row_ids = batch.column(_ROW_ID).to_pylist()
            for field in batch.schema.names if name else ():
                told = ((row_id, item) for row_id, item in zip(row_ids, batch.column(field)) if item.is_valid)
                if field != _ROW_ID and (newest := max(told, key=lambda row: row[0], default=None)):
                    latest[name, field] = max(newest, latest.get((name, field), newest), key=lambda row: row[0])
        found: dict[str, dict] = {}
        for (name, field), (_, item) in latest.items():
            found.setdefault(name, {})[field] = _value(item)
        return found

    def _rows(self, content: str, *names: str) -> Iterator[tuple]:
        """(chunk, a column for each of `names`) for every chunk at the entity paths."""
        for chunk in self._chunks(content):
            yield chunk, *self._columns(chunk, *names)

    def _chunks(self, content: str, static: bool = False) -> Iterator[Chunk]:
        try:        # the index in the footer saves reading what is not asked for
            reader, chosen = self._reader, self._store
            stream = reader.store(store=chosen).stream() if self.is_finished() else reader.stream(store=chosen)
            yield from stream.filter(content=content, is_static=static)
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None

    def _columns(self, chunk: Chunk, *names: str) -> list:
        """Columns of a chunk: the times as int64 [rows], everything else as Arrow lists, one for each row."""
        columns = [self._optional(chunk, name) for name in names]
        missing = [name for name, column in zip(names, columns) if column is None]
        require(not missing, "recording", str(self.path), f"{chunk.entity_path} with {missing and missing[0]}")
        return columns

    def _optional(self, chunk: Chunk, name: str):
        """A column as `_columns` gives it; None if the chunk has none of this name."""
        batch = chunk.to_record_batch()
        if name not in batch.schema.names:
            return None
        column = batch.column(name)
        # Times as a copy: a view would keep all of the chunk in memory.
        return np.array(column.cast(pa.int64())) if name in (layout.STAMP, layout.FRAME) else column

    def _unreadable(self, error: Exception) -> InvalidInput:
        if isinstance(error, InvalidInput):
            return error
        why = " ".join(str(error).removeprefix(f"Failed to read RRD file at {self.path}: ").split())
        return InvalidInput("recording", str(self.path), f"an .rrd file that can be read ({why})")


def _lengths(column) -> np.ndarray:
    """Number of values in each row, int64; 0 where there is none."""
    return column.value_lengths().fill_null(0).to_numpy(zero_copy_only=False).astype(np.int64)


def _array(item: pa.Scalar) -> np.ndarray:
    """The values of one row of one column, flat."""
    values = item.values
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    return values.to_numpy(zero_copy_only=False)


def _image(buffer: np.ndarray, image_format: dict, units_per_m: float | None) -> np.ndarray:
    shape = image_format["height"], image_format["width"]
    if units_per_m is not None:
        return layout.metres(buffer, shape, units_per_m)
    return buffer.view(_TYPES[image_format["channel_datatype"]]).reshape(shape)


def _value(item: pa.Scalar):
    values = item.as_py()
    return values[0] if len(values) == 1 else np.array(values)


def _in_order(stamp_ns: np.ndarray, values: np.ndarray) -> Series:
    order = np.argsort(stamp_ns, kind="stable")
    return Series(stamp_ns[order], values[order])
