"""SensorModel: geometry, timing and calibration of a single-photon lidar."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.projection import Pinhole, Projection
from srt3d_ros.errors import InvalidInput, finite, quoted, require

SPEED_OF_LIGHT = 299_792_458.0
MAX_SIDE = 65_536
MAX_PIXELS = 2**24
MAX_BINS = 65_535
BIN_WIDTHS_S = 1e-18, 1.0
MAX_RANGE_M = 1e12          # its square fits into float32
GAINS = 1e-4, 1e4
MAX_CYCLES = 10**9
MAX_DELAY_BINS = 1e6        # float32 still resolves an eighth of a bin


@dataclass(frozen=True)
class GateWords:
    """The ToA words of a gated SPAD array: bin = word − `first_word`; `no_detection` = no photon."""

    first_word: int = 0
    no_detection: int = 65_535

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require(0 <= value <= 65_535, f"gates.{name}", value, "a 16-bit word, 0 … 65535")


@dataclass(frozen=True, eq=False, repr=False)
class SensorModel:
    """Geometry, timing and calibration of a sensor.

    Depths and float ToA are positions on one axis of bins; an integer ToA b is the whole bin b, from b − ½ to b + ½.
    A surface at depth d puts `irf[irf_ref]` on the bin whose centre is at d: p(toa = b) ∝ irf[b − d + irf_ref]. It lies
    at range = c/2 · (toa_offset_bins + d) · bin_width_s + range_offset_m along its pixel's ray.

    Args:
        rows, cols: pixels; row 0 is the top row, pixel = row · cols + col.
        num_bins: T, bins of one laser period, or of a gate.
        bin_width_s: seconds, 1e-18 … 1.
        irf: float32 [L] for all pixels, or [rows · cols, L] for each; L ≤ T, 0 or more, normalised to sum 1 here.
        irf_ref: index into `irf` that marks the depth; the peak unless given.
        toa_offset_bins: bins from the laser pulse to position 0, the centre of bin 0.
        range_offset_m: metres added to every range. No range of bins 0 … T may exceed ±1e12 m.
        gain: float32 [rows, cols], relative detection efficiency, 1e-4 … 1e4; 1 if absent.
        delay_bins: float32 [rows, cols], bins by which a pixel's ToA come late, at most ±1e6; 0 if absent.
        mask: bool [rows, cols], False where a pixel must not be used (hot, dead); all True if absent.
        background_shape: float32 [T], how background photons spread over the bins of a pixel without delay;
            non-negative, not all zero, normalised to sum 1 here; evenly if absent.
        projection: Pinhole or AngularScan; a pinhole of 30° across the larger side unless given.
        gates: ToA words of a gated array, for the `gates` topic.
        histograms: bins of a histogramming sensor, for the `histograms` topic; T bins from bin 0 on if absent.
        cycles: laser cycles in a message of photons or histograms, if the detector records the first photon of each:
            pile-up is then corrected. `gates` messages have their number of cycles. None: not known, no correction.
        frame_id: the sensor's frame in tf.

    Raises:
        InvalidInput: naming the field that cannot be used.
    """

    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    irf: np.ndarray
    irf_ref: int | None = None
    toa_offset_bins: float = 0.0
    range_offset_m: float = 0.0
    gain: np.ndarray | None = None
    delay_bins: np.ndarray | None = None
    mask: np.ndarray | None = None
    background_shape: np.ndarray | None = None
    projection: Projection | None = None
    gates: GateWords | None = None
    histograms: HistogramBins | None = None
    cycles: int | None = None
    frame_id: str = "lidar"

    def __post_init__(self) -> None:
        for name, least, most in (("rows", 1, MAX_SIDE), ("cols", 1, MAX_SIDE), ("num_bins", 2, MAX_BINS)):
            value = _integer(name, getattr(self, name))
            require(least <= value <= most, name, value, f"an integer from {least} to {most}")
            self._set(name, value)
        require(self.pixels <= MAX_PIXELS, "rows × cols", f"{self.rows} × {self.cols}", f"at most {MAX_PIXELS} pixels")
        for name in ("bin_width_s", "toa_offset_bins", "range_offset_m"):
            self._set(name, finite(name, getattr(self, name)))
        least, most = BIN_WIDTHS_S
        require(least <= self.bin_width_s <= most, "bin_width_s", self.bin_width_s, f"seconds, {least:g} to {most:g}")
        with np.errstate(over="ignore"):
            farthest = float(np.abs(self.range_m([0, self.num_bins])).max())
        require(farthest <= MAX_RANGE_M, "range", f"{farthest:g} m", f"at most {MAX_RANGE_M:g} m, by toa_offset_bins, "
                "bin_width_s and range_offset_m")
        self._check_irf()
        self._check_maps()
        if self.cycles is not None:
            self._set("cycles", _integer("cycles", self.cycles))
            require(1 <= self.cycles <= MAX_CYCLES, "cycles", self.cycles, f"an integer from 1 to {MAX_CYCLES}")
        for name, kind in (("histograms", HistogramBins), ("gates", GateWords), ("projection", Projection)):
            value = getattr(self, name)
            require(value is None or isinstance(value, kind), name, quoted(value), f"a {name} object, or None")
        require(isinstance(self.frame_id, str), "frame_id", self.frame_id, "text")
        if self.histograms is not None:
            self.histograms.check(self.rows, self.cols, self.num_bins)
        if self.projection is None:
            self._set("projection", Pinhole.from_fov(self.rows, self.cols))
        if isinstance(self.projection, Pinhole):
            self.projection.check(self.rows, self.cols)

    def __repr__(self) -> str:
        return (f"Sensor of {self.rows} × {self.cols} pixels, {self.num_bins} bins of {self.bin_width_s * 1e12:.4g} ps "
                f"from {self.range_m(0):.4g} m on, IRF of {self.irf.shape[-1]} bins, {self.projection.kind}")

    def _set(self, name: str, value) -> None:
        object.__setattr__(self, name, value)

    def _check_irf(self) -> None:
        irf = _array("irf", self.irf, np.float64)
        require(irf.ndim in (1, 2) and irf.size > 0 and (irf.ndim == 1 or irf.shape[0] == self.pixels), "irf shape",
                irf.shape, f"[L], or [{self.pixels}, L] for an IRF per pixel")
        require(irf.shape[-1] <= self.num_bins, "irf length", irf.shape[-1], f"at most num_bins = {self.num_bins}")
        self._set("irf", _normalised("irf", irf, "finite float32 values of 0 or more (remove the baseline)"))
        peak = int(np.argmax(self.irf if irf.ndim == 1 else self.irf.sum(axis=0)))
        ref = peak if self.irf_ref is None else _integer("irf_ref", self.irf_ref)
        require(0 <= ref < irf.shape[-1], "irf_ref", ref, f"an index into the IRF, 0 … {irf.shape[-1] - 1}")
        self._set("irf_ref", ref)

    def _check_maps(self) -> None:
        shape = self.rows, self.cols
        for name, dtype, (low, high) in (("gain", np.float32, GAINS), ("mask", np.bool_, (False, True)),
                                         ("delay_bins", np.float32, (-MAX_DELAY_BINS, MAX_DELAY_BINS))):
            if getattr(self, name) is not None:
                value = _array(name, getattr(self, name), dtype)
                require(value.shape == shape, f"{name} shape", value.shape, f"[rows, cols] = {shape}")
                require(bool(((value >= low) & (value <= high)).all()), name, "not finite or out of bounds in places",
                        f"{low:g} to {high:g} (use mask for bad pixels)")
                self._set(name, value)
        if self.background_shape is not None:
            shape = _array("background_shape", self.background_shape, np.float64)
            require(shape.shape == (self.num_bins,), "background_shape shape", shape.shape,
                    f"({self.num_bins},), num_bins")
            self._set("background_shape", _normalised("background_shape", shape, "finite float32 values of 0 or more"))

    @property
    def pixels(self) -> int:
        """rows · cols."""
        return self.rows * self.cols

    @cached_property
    def rays(self) -> np.ndarray:
        """Unit rays in the sensor's frame, float32 [rows, cols, 3]."""
        return self.projection.rays(self.rows, self.cols)

    @cached_property
    def exposure(self) -> np.ndarray:
        """Photons of each pixel relative to one of gain 1: its gain, or 0 if masked. float32 [rows, cols]."""
        gain = np.ones((self.rows, self.cols), np.float32) if self.gain is None else self.gain
        return gain if self.mask is None else gain * self.mask

    @property
    def bin_width_m(self) -> float:
        """Metres of range in one bin, c/2 · bin_width_s."""
        return SPEED_OF_LIGHT / 2 * self.bin_width_s

    def toa_bins(self, toa: np.ndarray) -> np.ndarray:
        """The bin of each ToA, integers [N] in [0, T); integer ToA are bins."""
        return np.floor(toa + np.float32(0.5)).astype(np.int64) % self.num_bins if toa.dtype.kind == "f" else toa

    def range_m(self, depth_bins: ArrayLike) -> np.ndarray:
        """Range along the ray, metres, of depths in bins."""
        offset_bins = self.toa_offset_bins + np.asarray(depth_bins, dtype=np.float64)
        return offset_bins * self.bin_width_m + self.range_offset_m

    def depth_bins(self, range_m: np.ndarray) -> np.ndarray:
        """Depths in bins of ranges along the ray in metres, not wrapped; the inverse of `range_m`."""
        return (range_m - self.range_offset_m) / self.bin_width_m - self.toa_offset_bins

    def wrapped(self, depth_bins: np.ndarray) -> np.ndarray:
        """Depths modulo T: float32 in [0, T), where rounding to T becomes 0."""
        depth = np.mod(depth_bins, self.num_bins).astype(np.float32)
        depth[depth >= self.num_bins] = 0
        return depth

    def xyz(self, row: np.ndarray, col: np.ndarray, depth_bins: np.ndarray) -> np.ndarray:
        """Points in the sensor's frame, metres, float32 [N, 3]."""
        pixel = np.ravel_multi_index((row, col), (self.rows, self.cols))
        rays = self.rays.reshape(-1, 3).take(pixel, axis=0)         # several times faster than [row, col]
        return (rays * self.range_m(depth_bins)[:, None]).astype(np.float32)

    def replace(self, **changes: Any) -> "SensorModel":
        """A copy with some fields changed; they are checked."""
        return replace(self, **changes)

    def cropped(self, rows: slice, cols: slice = slice(None)) -> "SensorModel":
        """The sensor of a window of rows and columns, such as slice(10, 40); rays and calibration stay the same.

        Raises:
            InvalidInput: the window is empty or has a step.
        """
        shape = self.rows, self.cols
        (first_row, row_count), (first_col, col_count) = _span("rows", rows, self.rows), _span("cols", cols, self.cols)
        maps = {name: getattr(self, name) for name in ("gain", "delay_bins", "mask")}
        of_pixels = {name: values[rows, cols] for name, values in maps.items() if values is not None}
        if self.irf.ndim == 2:
            of_pixels["irf"] = self.irf.reshape(*shape, -1)[rows, cols].reshape(-1, self.irf.shape[1])
        return self.replace(rows=row_count, cols=col_count, **of_pixels,
                            histograms=self.histograms and self.histograms.cropped(rows, cols, shape),
                            projection=self.projection.cropped(first_row, first_col))

    def same_as(self, other: "SensorModel | None") -> bool:
        """True if both describe the same sensor. Skips values that are one object: an IRF per pixel takes 10 ms."""
        pairs = ((getattr(self, name), getattr(other, name, None)) for name in self.__dataclass_fields__)
        return self is other or other is not None and all(mine is its or np.array_equal(mine, its)
                                                          for mine, its in pairs)


def _span(name: str, part: slice, side: int) -> tuple[int, int]:
    """The first pixel along a side that a slice keeps, and the number of pixels."""
    first, end, step = part.indices(side) if isinstance(part, slice) else (0, 0, 1)
    require(step == 1 and first < end, name, part, f"a slice with some of 0:{side} in it, in steps of 1")
    return first, end - first


def _normalised(name: str, density: np.ndarray, wanted: str) -> np.ndarray:
    """float32 densities with sum 1 along the last axis."""
    require(bool(((density >= 0) & (density <= np.finfo(np.float32).max)).all()), name,
            "negative or not finite in places", wanted)
    total = density.sum(axis=-1, keepdims=True)
    require(bool((total > 0).all()), name, "all zero", f"{wanted}, not all 0")
    if not np.allclose(total, 1, rtol=0, atol=1e-6):        # a copy of a sensor keeps its bits
        density = density / total
    return np.ascontiguousarray(density, dtype=np.float32)


def _integer(name: str, value) -> int:
    number = finite(name, value)
    require(number == int(number), name, quoted(value), "an integer")
    return int(number)


def _array(name: str, value, dtype) -> np.ndarray:
    try:
        with np.errstate(over="ignore"):        # values too large for float32 become infinite and are refused
            return np.ascontiguousarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(name, quoted(value), f"an array of {np.dtype(dtype).name}") from None
