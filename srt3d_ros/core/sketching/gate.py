"""Gate: keeps the photons of some bins. T becomes the number of these, and background elsewhere is dropped."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.errors import InvalidInput, require

OFF, AUTO = "off", "auto"
FORM = "off, FIRST-LAST (100-400), or auto (files only)"


class Gate:
    """The depths from bin `first` to bin `last` of a sensor, and the ToA of their photons.

    Pixels' delays widen the gate by their spread: a ToA is kept if it is inside for any pixel. The gated bins are
    treated as circular. A surface whose pulse crosses one end may appear at the other, so leave the length of a
    pulse at both ends. Ranges do not change.

    Args:
        source: the sensor of the photons.
        first, last: bins of depth, both kept; InvalidInput unless in order and at least as many as the IRF has.

    Attributes:
        num_bins: T of the gate: last − first + 1 plus the spread of the delays, at most that of `source`.
        start: the first bin of ToA that is kept; the gate may wrap around the end of the period of `source`.
        sensor: describes the photons that are kept.
    """

    def __init__(self, source: SensorModel, first: int, last: int):
        text, most, irf = f"{first}-{last}", source.num_bins - 1, source.irf.shape[-1]
        require(0 <= first < last <= most, "gate", text, f"first and last within the sensor's bins, 0 to {most}")
        require(last - first + 1 >= irf, "gate", text, f"{irf} bins or more, as many as the IRF has")
        self.source, self.first, self.last = source, first, last
        lates = source.late[source.used] if source.used.any() else source.late
        least, greatest = int(np.floor(lates.min())), int(np.ceil(lates.max()))
        self.num_bins = last - first + 1 + greatest - least
        if self.num_bins >= source.num_bins:        # keeps every bin
            self.start, self.num_bins, self.sensor = 0, source.num_bins, source
            return
        self.start = (first + least) % source.num_bins
        shape = source.background_shape
        if shape is not None:
            shape = np.take(shape, np.arange(first, first + self.num_bins), mode="wrap")
            shape = shape if shape.any() else None
        period_s = source.dead_time.period * source.bin_width_s if source.dead_time.periods else source.period_s
        self.sensor = source.replace(
            num_bins=self.num_bins, toa_offset_bins=source.toa_offset_bins + first, background_shape=shape, gates=None,
            histograms=None, period_s=period_s,
            delay_bins=None if source.delay_bins is None else source.late - np.float32(least))

    def __str__(self) -> str:
        return f"{self.first}-{self.last}"

    def photons(self, events: PhotonEvents) -> PhotonEvents:
        """The photons inside, in the bins of `self.sensor`."""
        # Float ToA of bin b begin at b − ½, which may wrap around.
        half, wide = (0.5, np.float64) if events.toa.dtype.kind == "f" else (0, np.int32)
        from_start = (events.toa.astype(wide) + half - self.start) % self.source.num_bins
        inside = np.flatnonzero(from_start < self.num_bins)
        toa = (from_start[inside] - half) % self.num_bins
        return replace(events.part(inside), toa=self.sensor.toa_within(toa) if half else toa.astype(events.toa.dtype))


def in_ranges(gate: Gate | None) -> str:
    """The bins of a gate and their ranges, for people to read."""
    if gate is None:
        return OFF
    nearest, farthest = gate.source.range_m([gate.first, gate.last])
    return f"{gate}, {nearest:.4g} to {farthest:.4g} m"


def parse(spec: str | Sequence[int]) -> tuple[int, int] | str:
    """First and last bin, OFF or AUTO, from 100-400, 100:400, [100, 400], off or auto; InvalidInput for others."""
    if isinstance(spec, str) and spec in (OFF, AUTO):
        return spec
    text = spec if isinstance(spec, str) or np.ndim(spec) != 1 else ",".join(map(str, spec))
    numbers = re.fullmatch(r"\s*[\[(]?\s*(-?\d{1,9})\s*[-:,]\s*(-?\d{1,9})\s*[\])]?\s*", str(text))
    if numbers is None:
        raise InvalidInput("gate", spec, FORM)
    first, last = int(numbers[1]), int(numbers[2])
    require(0 <= first < last, "gate", spec, "a first bin of 0 or more and below the last")
    return first, last
