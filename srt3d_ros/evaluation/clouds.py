"""Clouds for the pictures: read back from the folder of an evaluation, or made of the truth."""

from pathlib import Path

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.files import read_npz_arrays
from srt3d_ros.evaluation.cases import Observation


def load_cloud(path: Path) -> PointCloud:
    """A cloud that cloud_files.save wrote as .npz."""
    names = tuple(PointCloud.__dataclass_fields__)
    arrays = read_npz_arrays(path, names)
    return PointCloud(**{name: arrays[name] for name in names if name != "stamp_ns"}, stamp_ns=int(arrays["stamp_ns"]))


def true_cloud(observation: Observation, sensor: SensorModel) -> PointCloud | None:
    """The cloud that a perfect reconstruction would give; None where the truth is not known."""
    if observation.depth_bins is None:
        return None
    depth = observation.depth_bins
    row, col, surface = np.nonzero(np.moveaxis(np.isfinite(depth), 0, -1))
    intensity = np.ones_like(depth) if observation.intensity is None else np.nan_to_num(observation.intensity, nan=0.0)
    depth_bins = depth[surface, row, col].astype(np.float32)
    background = np.zeros((sensor.rows, sensor.cols)) if observation.background is None else observation.background
    return PointCloud(row.astype(np.uint16), col.astype(np.uint16), depth_bins,
                      intensity[surface, row, col].astype(np.float32), np.zeros(len(row), np.float32),
                      sensor.xyz(row, col, depth_bins), surface.astype(np.uint8), background.astype(np.float32))
