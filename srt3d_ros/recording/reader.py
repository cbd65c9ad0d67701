"""Read a recording's clouds, images, time series and properties without a viewer."""

import os
from collections import defaultdict
from collections.abc import Container, Iterator
from dataclasses import dataclass
from functools import cached_property
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

_ROW_ID, _TIMES = "rerun.controls.RowId", (entities.STAMP, entities.FRAME_INDEX)
_HEADER_MARK, _FOOTER_MARK = b"RRF2", b"RRF2FOOT"       # the footer ends in its mark and the number of indices
_FOOTER_BYTES = 12


@dataclass(frozen=True, eq=False)
class RecordedCloud:
    """A cloud of a recording."""

    stamp_ns: int
    frame_index: int
    xyz: np.ndarray                         # float32 [N, 3], metres
    intensity: np.ndarray                   # float32 [N], photons
    colour: np.ndarray                      # uint32 [N], 0xRRGGBBAA, as shown
    more: dict[str, np.ndarray]             # [N] each, those of entities.OF_FULL_CLOUDS that were recorded

    def placed(self, sensor: SensorModel) -> PointCloud:
        """The PointCloud, for clouds recorded with all columns; its background is NaN."""
        depth_bins = sensor.depth_bins(np.linalg.norm(self.xyz.astype(np.float64), axis=1)).astype(np.float32)
        background = np.full((sensor.rows, sensor.cols), np.nan, np.float32)
        return PointCloud(self.more["row"], self.more["col"], depth_bins, self.intensity,
                          self.more["depth_std"] / np.float32(sensor.bin_width_m), self.xyz, self.more["surface"],
                          background, self.stamp_ns, sensor=sensor)


@dataclass(frozen=True, eq=False)
class Series:
    """A time series sorted by stamp: int64 [N] stamps in nanoseconds and float64 [N] values."""

    stamp_ns: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class CloudIndex:
    """All clouds sorted by stamp: int64 [N] stamps in nanoseconds, frame indices and numbers of points."""

    stamp_ns: np.ndarray
    frame_index: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.stamp_ns)


class RecordingReader:
    """An .rrd file of RecordingWriter; InvalidInput if it is absent, no recording, or cut off."""

    def __init__(self, path: str | Path):
        self.path = Path(path)
        _check_footer(self.path)
        try:
            self._reader = RrdReader(self.path)
            entries = self._reader.recordings()
        except (RuntimeError, ValueError) as e:
            raise self._unreadable(e) from None
        require(len(entries) > 0, "recording", problem=f"{path} holds no recording.")
        self._store = entries[0]        # rerun warns if it chooses by itself

    @cached_property
    def index(self) -> CloudIndex:
        """Stamp, frame index and number of points of every cloud; shows a progress bar after 2 s."""
        rows = self._rows(entities.POINTS_PATH, entities.STAMP, entities.FRAME_INDEX, "Points3D:positions")
        return CloudIndex(*_by_stamp([(np.empty(0, np.int64),) * 3, *(
            (stamps, frames, np.array(xyz.value_lengths().fill_null(0), np.int64))
            for _, stamps, frames, xyz in tqdm(rows, "reading", delay=2, leave=False, unit="chunk"))]))

    def clouds(self, only: Container[int] | None = None) -> Iterator[RecordedCloud]:
        """Yield clouds in the order logged; `only` those with these frame indices."""
        names = ("Points3D:positions", entities.INTENSITY_COMPONENT, "Points3D:colors")
        for stamp, frame, xyz, intensity, colour, *more in self._selected(
                entities.POINTS_PATH, only, names, optional=entities.OF_FULL_CLOUDS):
            yield RecordedCloud(stamp, frame, _array(xyz).reshape(-1, 3), _array(intensity), _array(colour),
                                {name: _array(item) for name, item in zip(entities.OF_FULL_CLOUDS, more)
                                 if item is not None and item.is_valid})

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

    @cached_property
    def series(self) -> dict[str, Series]:
        """All time series by name."""
        parts = defaultdict(list)
        for chunk, stamps, values in self._rows(f"{entities.METRICS_PATH}/**", entities.STAMP, "Scalars:scalars"):
            parts[chunk.entity_path.removeprefix(f"{entities.METRICS_PATH}/")].append(
                (stamps, values.flatten().to_numpy()))
        return {name: Series(*_by_stamp(of_name)) for name, of_name in parts.items()}

    @cached_property
    def properties(self) -> dict[str, dict]:
        """The newest facts of each property: {"run": {…}, "sensor": {…}}; lists as arrays."""
        rows = [(row.pop(_ROW_ID), chunk.entity_path.removeprefix(f"{entities.PROPERTIES}/"), row)
                for chunk in self._chunks(f"{entities.PROPERTIES}/**", static=True)
                if chunk.entity_path != entities.PROPERTIES         # of rerun itself
                for row in chunk.to_record_batch().to_pylist()]
        found: dict[str, dict] = {}
        for _, name, row in sorted(rows, key=lambda row: row[0]):       # facts may be set again
            found.setdefault(name, {}).update({field: values[0] if len(values) == 1 else np.array(values)
                                               for field, values in row.items() if values is not None})
        return found

    def _selected(self, path: str, only: Container[int] | None, names: tuple[str, ...], optional: tuple[str, ...] = ()
                  ) -> Iterator[tuple]:
        """Yield (stamp_ns, frame_index, item of each column) for the frame indices in `only`; None: no such column."""
        for _, stamps, frames, *columns in self._rows(
                path, entities.STAMP, entities.FRAME_INDEX, *names, optional=optional):
            for row, (stamp, frame) in enumerate(zip(stamps.tolist(), frames.tolist())):
                if only is None or frame in only:
                    yield stamp, frame, *(None if column is None else column[row] for column in columns)

    def _rows(self, content: str, *names: str, optional: tuple[str, ...] = ()) -> Iterator[tuple]:
        """Yield (chunk, column of each name) for the chunks at entity paths; a missing `optional` column is None.

        Times are int64 [rows], others Arrow lists.
        """
        for chunk in self._chunks(content):
            batch = chunk.to_record_batch()
            missing = [name for name in names if name not in batch.schema.names]
            require(not missing, "recording", problem=f"{self.path}: {chunk.entity_path} has no {', '.join(missing)}.")
            columns = (batch.column(name) for name in names)
            # Copy times: a view would keep the whole chunk in memory.
            yield (chunk, *(np.array(column.cast(pa.int64())) if name in _TIMES else column
                            for name, column in zip(names, columns)),
                   *(batch.column(name) if name in batch.schema.names else None for name in optional))

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


def _by_stamp(parts: list[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """The columns of several chunks, the first of which are stamps, joined and sorted by these."""
    columns = [np.concatenate(column) for column in zip(*parts)]
    order = np.argsort(columns[0], kind="stable")
    return [column[order] for column in columns]


def _array(item: pa.Scalar) -> np.ndarray:
    """The values of a row in a column, flat."""
    values = item.values
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    return values.to_numpy(zero_copy_only=False)
