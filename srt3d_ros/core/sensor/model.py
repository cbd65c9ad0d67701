"""SensorModel: geometry, timing and calibration of a single-photon lidar."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from srt3d_ros.core.keys import Key, documented, keys, numbers
from srt3d_ros.core.sensor.bins import MAX_BINS, HistogramBins
from srt3d_ros.core.sensor.dead_time import DeadTime
from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.projection import Pinhole, Projection
from srt3d_ros.errors import InvalidInput, quoted, require

SPEED_OF_LIGHT = 299_792_458.0
MAX_SIDE = 65_536
MAX_PIXELS = 2**24
MAX_RANGE_M = 1e12          # its square fits into float32
DELAYS = -1e6, 1e6          # bins; float32 still resolves an eighth of a bin
WORDS = 0, 65_535           # 16 bits
PIXEL_MAPS = "gain", "delay_bins", "mask"      # [rows, cols]


@documented
@dataclass(frozen=True)
class GateWords:
    """How a gated SPAD array writes its ToA words: bin = word − first_word."""

    first_word: Annotated[int, Key("word of bin 0", "word", WORDS, needed=True)] = 0
    no_detection: Annotated[int, Key("word of a cycle in which the pixel saw nothing", "word", WORDS, needed=True)
                            ] = 65_535

    def __post_init__(self) -> None:
        numbers(self, "gates.")


@documented
@dataclass(frozen=True, eq=False, repr=False)
class SensorModel:
    """Geometry, timing and calibration of a sensor: what its photons do not say.

    Depths and float ToA are positions on one axis of bins; an integer ToA b is the whole bin b, from b − ½ to b + ½.
    A return from depth d is distributed as the IRF with its reference bin at d: p(toa = b) ∝ irf[b − d + irf_ref]. It
    lies at range = c/2 · (toa_offset_bins + d) · bin_width_s + range_offset_m along its pixel's ray.

    Raises:
        InvalidInput: naming the field that cannot be used. No range of bins 0 … T may exceed ±1e12 m.
    """

    rows: Annotated[int, Key("rows of pixels, row 0 at the top", "pixel", (1, MAX_SIDE), "pixel = row · cols + col",
                             option=True)]
    cols: Annotated[int, Key("columns of pixels, column 0 on the left", "pixel", (1, MAX_SIDE), option=True)]
    num_bins: Annotated[int, Key("T, bins of one laser period", "bin", (2, MAX_BINS),
                                 "or of the gate that wraps like one", option=True)]
    bin_width_s: Annotated[float, Key("width of a bin", "s", (1e-18, 1.0), option=True)]
    irf: Annotated[np.ndarray, Key("impulse response, photons in each bin", "any", more="L ≤ num_bins, 0 or more, "
                                   "baseline removed; any sum", dtype="float32",
                                   shape="[L] for all pixels, or [rows · cols, L]", option=True)]
    irf_ref: Annotated[int | None, Key("entry of the IRF that marks the depth (default: its peak)", "bin",
                                       option=True)] = None
    toa_offset_bins: Annotated[float, Key(
        "from the laser pulse to the centre of bin 0", "bin", more="there is position 0 of float ToA and depths; 0.5 "
        "more for a clock that truncates", option=True)] = 0.0
    range_offset_m: Annotated[float, Key("added to every range", "m", option=True)] = 0.0
    gain: Annotated[np.ndarray | None, Key("relative detection efficiency", "1", (1e-4, 1e4), "default 1",
                                           "float32", "[rows, cols]")] = None
    delay_bins: Annotated[np.ndarray | None, Key("how late a pixel's ToA come", "bin", DELAYS, "default 0",
                                                 "float32", "[rows, cols]")] = None
    mask: Annotated[np.ndarray | None, Key("false where a pixel must not be used (hot, dead)", "1", (False, True),
                                           "default true", "bool", "[rows, cols]")] = None
    background_shape: Annotated[np.ndarray | None, Key(
        "how background photons spread over the bins of a pixel without delay", "any",
        more="0 or more, any sum; default: evenly", dtype="float32", shape="[num_bins]")] = None
    projection: Annotated[Projection, Key(
        "where the pixels look", more="default: a pinhole of 30° across the larger side", array="projection_values")
        ] = None        # pyright: ignore[reportAssignmentType]     the default needs rows and cols
    gates: Annotated[GateWords | None, Key("ToA words of the `gates` topic", more="needed only there",
                                           array="gate_words")] = None
    histograms: Annotated[HistogramBins | None, Key(
        "bins of the `histograms` topic", more="default: the sensor's num_bins bins, from bin 0 on",
        array="histogram_bins")] = None
    cycles: Annotated[int | None, Key(
        "laser cycles of a message or of a file's frame, to correct pile-up in a detector that records only the first "
        "photon of each cycle",
        "cycle", (1, 10**9), "those of `gates` messages are counted; default: unknown, no correction",
        option=True)] = None
    dead_time_s: Annotated[float | None, Key(
        "how long a pixel is blind after a photon, for `cycles` where that is a laser period or longer", "s", (0, 1),
        "default: to the end of the cycle", option=True)] = None
    period_s: Annotated[float | None, Key(
        "laser period, for `dead_time_s`", "s", (1e-18, 1e5), "default: num_bins bins; longer where these are a gate"
        )] = None
    frame_id: Annotated[str, Key("the sensor's frame in tf")] = "lidar"
    extrinsics: Annotated[str | None, Key(
        "pose of the sensor in the frame that `odom` reports on, x y z in metres and a quaternion qx qy qz qw",
        more="default: unknown, or the sensor does not move")] = None

    def __post_init__(self) -> None:
        for name, value in numbers(self).items():
            self._set(name, value)
        require(self.pixels <= MAX_PIXELS, "rows × cols", f"{self.rows} × {self.cols}", f"at most {MAX_PIXELS} pixels")
        with np.errstate(over="ignore"):
            farthest = float(np.abs(self.range_m([0, self.num_bins])).max())
        require(farthest <= MAX_RANGE_M, "range", f"{farthest:g} m", f"at most {MAX_RANGE_M:g} m, by toa_offset_bins, "
                "bin_width_s and range_offset_m")
        self._check_irf()
        self._check_arrays()
        require(self.dead_time.period >= self.num_bins, "period_s", self.period_s, f"{self.num_bins} bins or more")
        for name in ("projection", "gates", "histograms"):
            value, kinds = getattr(self, name), keys(SensorModel)[name].kinds
            require(value is None or isinstance(value, kinds), name, quoted(value),
                    f"{' or '.join(kind.__name__ for kind in kinds)}, or None")
        require(isinstance(self.frame_id, str), "frame_id", self.frame_id, "text")
        require(isinstance(self.extrinsics, str | None), "extrinsics", self.extrinsics, "text")
        if self.histograms is not None:
            self.histograms.check(self.pixels, self.num_bins)
        if self.projection is None:
            self._set("projection", Pinhole.from_fov(*self.shape))
        if isinstance(self.projection, Pinhole):
            self.projection.check(*self.shape)

    def __repr__(self) -> str:
        return (f"Sensor of {self.rows} × {self.cols} pixels, {self.num_bins} bins of {self.bin_width_s * 1e12:.4g} ps "
                f"from {self.range_m(0):.4g} m on, IRF of {self.irf.shape[-1]} bins, {self.projection.kind}")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check_irf(self) -> None:
        irf = _array("irf", self.irf, np.float64)
        require(irf.ndim in (1, 2) and irf.size > 0 and (irf.ndim == 1 or irf.shape[0] == self.pixels), "irf shape",
                irf.shape, f"[L], or [{self.pixels}, L] for an IRF per pixel")
        require(irf.shape[-1] <= self.num_bins, "irf length", irf.shape[-1], f"at most num_bins = {self.num_bins}")
        self._set("irf", _normalised("irf", irf, "finite float32 values of 0 or more (remove the baseline)"))
        peak = int(np.argmax(self.irf if irf.ndim == 1 else self.irf.sum(axis=0)))
        ref = peak if self.irf_ref is None else self.irf_ref
        require(0 <= ref < irf.shape[-1], "irf_ref", ref, f"an index into the IRF, 0 … {irf.shape[-1] - 1}")
        self._set("irf_ref", ref)

    def _check_arrays(self) -> None:
        for name, shape in {**dict.fromkeys(PIXEL_MAPS, self.shape), "background_shape": (self.num_bins,)}.items():
            key, given = keys(SensorModel)[name], getattr(self, name)
            if given is None:
                continue
            value = _array(name, given, key.dtype if key.bounds else np.float64)
            require(value.shape == shape, f"{name} shape", value.shape, f"{key.shape} = {shape}")
            if key.bounds:
                inside = (value >= key.bounds[0]) & (value <= key.bounds[1])
                require(bool(inside.all()), name, "has values that are not finite or are outside",
                        f"{key.expected} (use mask for bad pixels)")
            else:
                value = _normalised(name, value, "finite float32 values of 0 or more")
            self._set(name, value)

    @property
    def shape(self) -> tuple[int, int]:
        """rows, cols."""
        return self.rows, self.cols

    @property
    def pixels(self) -> int:
        """rows · cols."""
        return self.rows * self.cols

    @cached_property
    def rays(self) -> np.ndarray:
        """Unit rays in the sensor's frame, float32 [rows, cols, 3]."""
        return self.projection.rays(*self.shape)

    @cached_property
    def late(self) -> np.ndarray:
        """Bins by which the ToA of each pixel come late: `delay_bins`, or 0. float32 [rows, cols]."""
        return np.zeros(self.shape, np.float32) if self.delay_bins is None else self.delay_bins

    @cached_property
    def used(self) -> np.ndarray:
        """Where a pixel may be used: `mask`, or everywhere. bool [rows, cols]."""
        return np.ones(self.shape, bool) if self.mask is None else self.mask

    @property
    def irf_bins(self) -> np.ndarray:
        """The bins of the IRF's entries, counted from the one that marks the depth; int [L]."""
        return np.arange(self.irf.shape[-1]) - (self.irf_ref or 0)

    @cached_property
    def mean_irf(self) -> np.ndarray:
        """The IRF, or the mean of all pixels'. float32 [L]."""
        return self.irf if self.irf.ndim == 1 else self.irf.mean(axis=0)

    @cached_property
    def exposure(self) -> np.ndarray:
        """Photons of each pixel relative to one of gain 1: its gain, or 0 if masked. float32 [rows, cols]."""
        gain = np.ones(self.shape, np.float32) if self.gain is None else self.gain
        return gain * self.used

    @cached_property
    def dead_time(self) -> DeadTime:
        """Which bins a photon blinds its pixel for."""
        period, dead = (round((time_s or 0) / self.bin_width_s, 6) for time_s in (self.period_s, self.dead_time_s))
        periods, rest = divmod(dead, period or self.num_bins)
        return DeadTime(int(periods), rest if periods else 0.0, period or self.num_bins, self.num_bins)

    @property
    def gate_words(self) -> GateWords:
        """How its gates write ToA; InvalidInput if it has none."""
        if self.gates is None:
            raise InvalidInput("sensor.gates", "missing", "first_word and no_detection, to read gates")
        return self.gates

    @property
    def histogram_size(self) -> int:
        """Bins of a pixel's histogram."""
        return self.num_bins if self.histograms is None else self.histograms.num_bins

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

    def toa_within(self, toa: np.ndarray) -> np.ndarray:
        """ToA in [0, T) as float32, where rounding to T becomes the next number below."""
        return np.minimum(toa.astype(np.float32), np.nextafter(np.float32(self.num_bins), np.float32(0)))

    def wrapped(self, depth_bins: np.ndarray) -> np.ndarray:
        """Depths modulo T: float32 in [0, T), where rounding to T becomes 0."""
        depth = np.mod(depth_bins, self.num_bins).astype(np.float32)
        depth[depth >= self.num_bins] = 0
        return depth

    def xyz(self, row: np.ndarray, col: np.ndarray, depth_bins: np.ndarray) -> np.ndarray:
        """Points in the sensor's frame, metres, float32 [N, 3]."""
        pixel = np.ravel_multi_index((row, col), self.shape)
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
        (first_row, row_count), (first_col, col_count) = _span("rows", rows, self.rows), _span("cols", cols, self.cols)
        maps = {name: getattr(self, name) for name in PIXEL_MAPS}
        of_pixels = {name: values[rows, cols] for name, values in maps.items() if values is not None}
        if self.irf.ndim == 2:
            of_pixels["irf"] = self.irf.reshape(*self.shape, -1)[rows, cols].reshape(-1, self.irf.shape[1])
        return self.replace(rows=row_count, cols=col_count, **of_pixels,
                            histograms=self.histograms and self.histograms.cropped(rows, cols, self.shape),
                            projection=self.projection.cropped(first_row, first_col))

    def same_as(self, other: "SensorModel | None") -> bool:
        """True if both describe the same sensor to the bit."""
        return first_difference(self, other, rtol=0) is None


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


def _array(name: str, value: ArrayLike, dtype: DTypeLike) -> np.ndarray:
    try:
        with np.errstate(over="ignore"):        # values too large for float32 become infinite and are refused
            return np.ascontiguousarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(name, quoted(value), f"an array of {np.dtype(dtype).name}") from None
