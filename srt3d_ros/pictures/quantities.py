"""What the colours of points can show, each with its values, unit and colours."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.pulse import equivalent_width
from srt3d_ros.pictures.colours import BACKGROUND, PHOTON_TABLE, RANGE_TABLE, levels
from srt3d_ros.pictures.units import number_text


class Points(Protocol):
    """What is drawn: a cloud, or one of a recording, which has no quantities but range and intensity."""

    @property
    def xyz(self) -> np.ndarray: ...
    @property
    def intensity(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Quantity:
    """A number of each point.

    Args:
        label, unit: for people.
        values: the numbers of a cloud, [N].
        table: the colours from low to high, uint8 [256, 3].
        root: whether square roots are spread evenly, as for photons.
    """

    label: str
    unit: str
    values: Callable[[Any], np.ndarray]
    table: np.ndarray
    root: bool = False

    def levels(self, values: np.ndarray, ends: tuple[float, float] | None = None) -> np.ndarray:
        """Indices of values into `table`, uint8; `ends` as for `colours.levels`."""
        return levels(values, ends, self.root)

    def image(self, values: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
        """Colours of an image [rows, cols], uint8 [rows, cols, 3]; BACKGROUND where it has no value."""
        colours = self.table[self.levels(values, ends)]
        colours[~np.isfinite(values)] = BACKGROUND
        return colours

    def text(self, value: float) -> str:
        return f"{number_text(value)} {self.unit}".rstrip()


def _range_m(cloud: Points) -> np.ndarray:
    return np.linalg.norm(cloud.xyz, axis=1)


def _snr(cloud: PointCloud) -> np.ndarray:
    """r / √(r + b) for r signal photons and the b of the background that the pulse sees: B / (T Σ h²), h the IRF."""
    share = min(equivalent_width(cloud.sensor) / cloud.sensor.num_bins, 1.0)
    return cloud.intensity / np.sqrt(cloud.intensity + share * np.maximum(cloud.background[cloud.row, cloud.col], 0))


RANGE = Quantity("range", "m", _range_m, RANGE_TABLE)
PHOTONS = Quantity("intensity", "photons", lambda cloud: cloud.intensity, PHOTON_TABLE, root=True)
QUANTITIES = {
    "range": RANGE,
    "intensity": PHOTONS,
    "depth_std": Quantity("depth_std", "mm", lambda cloud: 1e3 * cloud.sensor.bin_width_m * cloud.depth_std_bins,
                          PHOTON_TABLE),
    "snr": Quantity("signal to noise", "", _snr, PHOTON_TABLE),
}
