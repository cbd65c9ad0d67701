"""Read a recording's clouds, images, time series and properties without a viewer."""

import os
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun import ChannelDatatype
from rerun.chunk import Chunk, RrdReader
from tqdm import tqdm

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.recording import entities

_ROW_ID = "rerun.controls.RowId"
_HEADER_MARK, _FOOTER_MARK = b"RRF2", b"RRF2FOOT"       # the footer ends in its mark and the number of indices
_FOOTER_BYTES = 12


@dataclass(frozen=True, eq=False)
class RecordedCloud:
    """A cloud of a recording; None = not recorded."""

    stamp_ns: int
    frame_index: int
    xyz: np.ndarray                         # float32 [N, 3], metres
    intensity: np.ndarray                   # float32 [N], photons
    colour: np.ndarray                      # uint32 [N], 0xRRGGBBAA, as shown
    depth_std_m: np.ndarray | None = None   # float32 [N]
    row: np.ndarray | None = None           # uint16 [N]
    col: np.ndarray | None = None           # uint16 [N]
    surface: np.ndarray | None = None       # uint8 [N], number within the pixel

    def placed(self, sensor: SensorModel) -> PointCloud:
        """The PointCloud, for clouds recorded with all columns; its background is NaN."""
        depth_bins = sensor.depth_bins(np.linalg.norm(self.xyz.astype(np.float64), axis=1)).astype(np.float32)
        depth_std_bins = self.depth_std_m / np.float32(sensor.bin_width_m)
        background = np.full((sensor.rows, sensor.cols), np.nan, np.float32)
        return PointCloud(self.row, self.col, depth_bins, self.intensity, depth_std_bins, self.xyz, self.surface,
                          background, self.stamp_ns, sensor=sensor)


@dataclass(frozen=True, eq=False)
class Series:
    """A time series sorted by stamp: int64 [N] stamps in nanoseconds and float64 [N] values."""

    stamp_ns: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class CloudIndex:
    """All clouds sorted by stamp: int64 [N] frame indices, stamps in nanoseconds and numbers of points."""

    frame_index: np.ndarray
    stamp_ns: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.stamp_ns)


class RecordingReader:
    """An .rrd file of RecordingWriter; InvalidInput if it is absent, no recording, or cut off."""

    def __init__(self, path):
        self.path = Path(path)
        _check_footer(self.path)
        try:
            self._reader = RrdReader(self.path)
            entries = self._reader.recordings()
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None
        require(len(entries) > 0, "recording", problem=f"{path} holds no recording.")
        self._store = entries[0]        # rerun warns if it chooses by itself

    def cloud_index(self) -> CloudIndex:
        """Stamp, frame index and number of points of every cloud; shows a progress bar after 2 s."""
        rows = self._rows(entities.POINTS_PATH, entities.FRAME_INDEX, entities.STAMP, "Points3D:positions")
        bar = tqdm(rows, "reading", delay=2, leave=False, unit="chunk")
        parts = [(frames, stamps, xyz.value_lengths().fill_null(0).to_numpy(zero_copy_only=False).astype(np.int64))
                 for _, frames, stamps, xyz in bar]
        frames, stamps, points = (np.concatenate(part) for part in zip(*parts)) if parts else [np.empty(0, int)] * 3
        order = np.argsort(stamps, kind="stable")
        return CloudIndex(frames[order], stamps[order], points[order])

    def clouds(self, only: Container[int] | None = None) -> Iterator[RecordedCloud]:
        """Yield clouds in the order logged; `only` those with these frame indices."""
        names = ("Points3D:positions", entities.INTENSITY_COMPONENT, "Points3D:colors")
        for stamp, frame, xyz, intensity, colour, *more in self._selected(
                entities.POINTS_PATH, only, names, optional=entities.OF_FULL_CLOUDS):
            yield RecordedCloud(stamp, frame, _array(xyz).reshape(-1, 3), _array(intensity), _array(colour),
                                *(_array(item) if item is not None and item.is_valid else None for item in more))

    def images(self, path: str, only: Container[int] | None = None) -> Iterator[tuple[int, int, np.ndarray]]:
        """Yield (stamp_ns, frame_index, image [rows, cols], NaN = none) of an entity path in the order logged."""
        names = ("DepthImage:buffer", "DepthImage:format")
        for stamp, frame, buffer, formats in self._selected(path, only, names):
            image_format = formats.as_py()[0]
            dtype = ChannelDatatype(image_format["channel_datatype"]).to_np_dtype()
            yield stamp, frame, _array(buffer).view(dtype).reshape(image_format["height"], image_format["width"])

    def empty_rays(self, only: Container[int] | None = None) -> Iterator[tuple[int, int, np.ndarray]]:
        """Yield (stamp_ns, frame_index, ends of rays [N, 3], float32, metres) in the order logged."""
        for stamp, frame, strips in self._selected(entities.FREE_PATH, only, ("LineStrips3D:strips",)):
            yield stamp, frame, _array(strips).reshape(-1, 2, 3)[:, 1]

    def poses(self) -> dict[int, Pose]:
        """Poses of a sensor that moved, from its frame to a fixed one, by frame index."""
        columns = "Transform3D:translation", "Transform3D:quaternion"
        return {frame: Pose.from_quaternion(_array(turn), _array(at))
                for _, frame, at, turn in self._selected(entities.POSE_PATH, None, columns)}

    def series(self) -> dict[str, Series]:
        """All time series by name."""
        parts: dict[str, list] = {}
        for chunk, stamps, values in self._rows(f"{entities.METRICS_PATH}/**", entities.STAMP, "Scalars:scalars"):
            name = chunk.entity_path.removeprefix(f"{entities.METRICS_PATH}/")
            parts.setdefault(name, []).append((stamps, values.flatten().to_numpy()))
        found = {}
        for name, of_name in parts.items():
            stamps, values = (np.concatenate(part) for part in zip(*of_name))
            order = np.argsort(stamps, kind="stable")
            found[name] = Series(stamps[order], values[order])
        return found

    def properties(self) -> dict[str, dict]:
        """The newest facts of each property: {"run": {…}, "sensor": {…}}; lists as arrays."""
        rows = []       # (row id, property, field, values); facts may be set again
        for chunk in self._chunks(f"{entities.PROPERTIES}/**", static=True):
            batch, name = chunk.to_record_batch(), chunk.entity_path.removeprefix(entities.PROPERTIES).strip("/")
            row_ids = batch.column(_ROW_ID).to_pylist()
            for field in batch.schema.names if name else ():
                rows += [(row_id, name, field, item.as_py()) for row_id, item in zip(row_ids, batch.column(field))
                         if item.is_valid and field != _ROW_ID]
        found: dict[str, dict] = {}
        for _, name, field, values in sorted(rows, key=lambda row: row[0]):
            found.setdefault(name, {})[field] = values[0] if len(values) == 1 else np.array(values)
        return found

    def _selected(self, path: str, only: Container[int] | None, names: tuple[str, ...], optional: tuple[str, ...] = ()
                  ) -> Iterator[tuple]:
        """Yield (stamp_ns, frame_index, item of each column) for the frame indices in `only`; None: no such column."""
        for chunk, stamps, frames, *columns in self._rows(path, entities.STAMP, entities.FRAME_INDEX, *names):
            columns += [_column(chunk, name) for name in optional]
            for row, (stamp, frame) in enumerate(zip(stamps.tolist(), frames.tolist())):
                if only is None or frame in only:
                    yield stamp, frame, *(None if column is None else column[row] for column in columns)

    def _rows(self, content: str, *names: str) -> Iterator[tuple]:
        """Yield (chunk, column of each name) for the chunks at entity paths; columns as from `_column`."""
        for chunk in self._chunks(content):
            columns = [_column(chunk, name) for name in names]
            missing = [name for name, column in zip(names, columns) if column is None]
            require(not missing, "recording", problem=f"{self.path}: {chunk.entity_path} has no {', '.join(missing)}.")
            yield chunk, *columns

    def _chunks(self, content: str, static: bool = False) -> Iterator[Chunk]:
        try:        # rerun reads only these chunks, by the index in the footer
            yield from self._reader.store(store=self._store).stream().filter(content=content, is_static=static)
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None

    def _unreadable(self, error: Exception) -> InvalidInput:
        why = " ".join(str(error).removeprefix(f"Failed to read RRD file at {self.path}: ").split())
        return InvalidInput("recording", problem=f"Cannot read recording {self.path} ({why}).")


def _check_footer(path: Path) -> None:
    """Raise InvalidInput if a recording lacks the index that is written when it is closed."""
    if path.is_file():
        with open(path, "rb") as file:
            begin, size = file.read(len(_HEADER_MARK)), file.seek(0, os.SEEK_END)
            file.seek(max(size - _FOOTER_BYTES, 0))
            cut_off = begin == _HEADER_MARK and not file.read().startswith(_FOOTER_MARK)
        require(not cut_off, "recording", problem=f"{path} is cut off. `rerun rrd filter --continue-on-error -o "
                f"saved.rrd {path.name}` saves what can be read.")


def _column(chunk: Chunk, name: str):
    """A column of a chunk: times as int64 [rows], others as Arrow lists; None if missing."""
    batch = chunk.to_record_batch()
    if name not in batch.schema.names:
        return None
    column = batch.column(name)
    # Copy times: a view would keep the whole chunk in memory.
    return np.array(column.cast(pa.int64())) if name in (entities.STAMP, entities.FRAME_INDEX) else column


def _array(item: pa.Scalar) -> np.ndarray:
    """The values of a row in a column, flat."""
    values = item.values
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    return values.to_numpy(zero_copy_only=False)
