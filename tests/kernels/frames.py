"""Frames and states on which the kernels are held against the oracle, and when results agree.

Tolerances: the kernels count in float32, with sines good to 7e-7. A depth in [0, 300) has steps of 3e-5 bins, which is
what most points differ by after a step. States here are such that photons partly contradict them, where a point hangs
on small differences: 1e-4 bins and 1e-4 of the other values for a step. A comparison between values that rounding tells
apart may be decided either way: one point in 100 may differ by more, up to 0.005 bins or 0.5 %.

Steps of a whole reconstruction enlarge such differences: those of the last bit of the sums, which any processor rounds
in its own way, to 0.02 standard deviations. Clouds are therefore compared with the noise.
"""

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import partial

import numpy as np
import torch

from srt3d_ros.core.method.matched_frame import MatchedFrame
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, choose_frequencies, irf_spectrum
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels import cpu, maps
from srt3d_ros.kernels import torch as oracle
from srt3d_ros.kernels.constants import SAME_SURFACE
from tests.core.scenes import matched_frame

T = 300
GATE = SAME_SURFACE**2
DEPTH_TOLERANCE = 1e-4          # bins, and bins per pixel
RELATIVE = 1e-4
NOISE_PART = 1 / 10             # of the standard deviation: as an independent error it would add 0.5 %
TYPICAL = 1 / 100               # of it, for half of the points: what is systematic is seen here
SHARE_AT_TIES = 1 / 100
FARTHEST_AT_TIES = 50           # times both, that any point may differ; measured 16 at most
SHAPES = [(6, 40), (9, 33)]     # eight columns beyond whole vectors, and one, so that padding matters
FAINT = 1 / 20                  # light with which votes matter as much as a pixel's own photons
STATES = [(shape, surfaces, seed) for shape in SHAPES for surfaces in (1, 2) for seed in (0, 1)]


class Backend:
    """The kernels of a backend, called with NumPy arrays and frames; their results are NumPy arrays."""

    def __init__(self, name: str, kernels):
        self.name, self.kernels = name, kernels

    def on(self, value):
        """The value as the kernels take it, arrays copied: kernels may change them."""
        if isinstance(value, np.ndarray):
            return self.kernels.array(value.copy())
        if is_dataclass(value):
            return replace(value, **{f.name: self.on(getattr(value, f.name)) for f in fields(value)})
        return value

    def off(self, value):
        """A result as NumPy arrays."""
        if isinstance(value, tuple):
            return tuple(map(self.off, value))
        return self.kernels.numpy(value) if isinstance(value, torch.Tensor) else value

    def __getattr__(self, name: str):
        """A kernel."""
        return partial(self.call, name)

    def kernel(self, name: str, arguments) -> Callable:
        """A kernel, with memory for its arguments."""
        first, *more = arguments
        if isinstance(first, MatchedFrame):
            surfaces = next((each.shape[1] for each in more if np.ndim(each) == 4), 1)
            shape = *first.shape, surfaces, tuple(np.rint(first.bin_frequencies * T).astype(int))
        elif name == "prepare":
            shape = *first.shape[:2], 1, tuple(range(1, 1 + first.shape[2]))
        else:
            return getattr(self.kernels, name)
        return getattr(self.kernels.for_shape(*shape), name)

    def call(self, name: str, *arguments):
        """What a kernel returns."""
        return self.off(self.kernel(name, arguments)(*map(self.on, arguments)))

    def changed(self, name: str, *arguments) -> list:
        """The arguments after a kernel that changes some."""
        given = [self.on(argument) for argument in arguments]
        self.kernel(name, arguments)(*given)
        return [self.off(argument) for argument in given]


CPU, ORACLE = Backend("cpu", cpu), Backend("oracle", oracle.on("cpu", torch.float64))
SINGLE = Backend("single", oracle.on("cpu", torch.float32))


def make_sensor(rows: int, cols: int, seed: int) -> SensorModel:
    """A sensor with an uneven gain and some masked pixels."""
    rng = np.random.default_rng(seed)
    return SensorModel(rows, cols, T, 1e-10, np.exp(-np.linspace(-2, 4, 25)**2),
                       gain=rng.uniform(0.5, 1.5, (rows, cols)), mask=rng.random((rows, cols)) > 0.05)


def make_sketch(sensor: SensorModel, seed: int, light: float = 1.0) -> PhaseSums:
    """Two layers that cross the end of the period, lit patchily, with the noise of photons; some pixels are dead.

    Of `light` 1 there are 20 background photons a pixel and 30 of each surface.
    """
    rng = np.random.default_rng(seed)
    frequencies = choose_frequencies("auto", sensor, 7)
    omega = angular_frequencies(frequencies, T)
    y, x = np.mgrid[:sensor.rows, :sensor.cols]
    near, far = layers(x, y)
    photons = rng.poisson(20 * light * sensor.gain)
    sums = rng.normal(size=(*x.shape, len(omega), 2)).view(complex)[..., 0] * np.sqrt(photons / 2)[..., None]
    for depth, shown in ((near, x < sensor.cols * 0.6), (far, True)):
        lit = rng.poisson(30 * light * sensor.gain) * (rng.random(x.shape) > 0.2) * shown
        phase = np.exp(1j * omega * depth[..., None])
        sums += lit[..., None] * irf_spectrum(sensor, frequencies) * phase
        photons = photons + lit
    dead = rng.random(x.shape) < 0.1
    sums[dead], photons[dead] = 0, 0
    return PhaseSums(frequencies, sums.astype(np.complex64), photons.astype(np.uint32), sensor=sensor)


def layers(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depths of the near and the far layer, bins; the near one beyond the end of the period."""
    return 290 + 0.6 * x - 0.4 * y, 80 - 1.5 * y


def make_frame(shape: tuple[int, int], seed: int, light: float = 1.0) -> MatchedFrame:
    sensor = make_sensor(*shape, seed)
    sketch = make_sketch(sensor, seed, light)
    return matched_frame(sensor, sketch)


def make_state(frame: MatchedFrame, surfaces: int, seed: int, light: float = 1.0) -> np.ndarray:
    """Points near the layers of `make_sketch`, some astray, some missing, some without a depth; and a hole in them."""
    rng = np.random.default_rng(seed + 100)
    rows, cols = frame.shape
    state = np.zeros(maps.state_shape(rows, cols, surfaces), np.float32)
    view = maps.crop(state, rows, cols)
    y, x = np.mgrid[:rows, :cols]
    near, far = layers(x, y)
    size = (rows, cols)
    hole = (np.abs(x - 0.5 * cols) < 4) & (y > 1)
    for k in range(surfaces):
        depth = np.where(rng.random(size) < 0.5, near, far) if surfaces == 1 else (near, far, near + 30, far - 40)[k]
        depth = np.where(rng.random(size) < 0.1, rng.uniform(0, T, size), depth)
        there = (rng.random(size) < (0.8, 0.8, 0.3, 0.3)[k]) & (frame.exposure > 0) & ~hole
        std = np.where(rng.random(size) < 0.02, T, rng.uniform(0.1, 2, size))       # T: the photons contradict it
        values = {maps.DEPTH: (depth + rng.normal(0, 1, size)) % T, maps.SLOPE_COL: rng.normal(0.3, 0.5, size),
                  maps.SLOPE_ROW: rng.normal(-0.5, 0.5, size), maps.INTENSITY: light * rng.uniform(1, 60, size),
                  maps.STD: std, maps.SCORE: rng.uniform(2, 30, size), maps.RESIDUAL: rng.uniform(0, 1, size)}
        for field, value in values.items():
            view[:, k, field] = np.where(there, value, 0)
    return state


def with_clutter(frame: MatchedFrame) -> MatchedFrame:
    """The frame before an uneven background."""
    return replace(frame, clutter=np.random.default_rng(0).uniform(1, 3, T).astype(np.float32))


def padded(frame: MatchedFrame) -> MatchedFrame:
    """The frame with padded maps, as the windowed kernels want them."""
    return replace(frame, matched=maps.pad(frame.matched.swapaxes(1, 2)), counts=maps.pad(frame.counts),
                   exposure=maps.pad(frame.exposure))


def make_terms(frame: MatchedFrame, state: np.ndarray) -> np.ndarray:
    """`expand` of a state as the kernels take it, by the oracle."""
    return ORACLE.expand(padded(frame), state)


def setting(shape: tuple[int, int], surfaces: int, seed: int, light: float = 1.0) -> tuple:
    """A frame with a state and its terms."""
    frame, state = make_frame(shape, seed, light), make_state(make_frame(shape, seed), surfaces, seed, light)
    return frame, state, make_terms(frame, state)


def exact_frame(depth: np.ndarray, signal: np.ndarray, background: float) -> MatchedFrame:
    """What is expected of surfaces at these depths with this many photons, [S, rows, cols]: no noise."""
    sensor = SensorModel(*depth.shape[1:], T, 1e-10, np.exp(-np.linspace(-2, 4, 25)**2))
    frequencies = choose_frequencies("auto", sensor, 7)
    phase = np.exp(1j * angular_frequencies(frequencies, T) * depth[..., None])
    sums = irf_spectrum(sensor, frequencies) * (signal[..., None] * phase).sum(axis=0)
    photons = np.rint(signal.sum(axis=0) + background)
    sketch = PhaseSums(frequencies, sums.astype(np.complex64), photons.astype(np.uint32), sensor=sensor)
    return matched_frame(sensor, sketch)


def exact_state(depth: np.ndarray, intensity: np.ndarray) -> np.ndarray:
    """The state with these points, [K, rows, cols], that were measured well; intensity 0 where there is none."""
    state = np.zeros(maps.state_shape(*depth.shape[1:], len(depth)), np.float32)
    view = maps.crop(state, *depth.shape[1:])
    view[:, :, maps.STD], view[:, :, maps.SCORE] = 0.3, 20
    view[:, :, maps.DEPTH], view[:, :, maps.INTENSITY] = depth.swapaxes(0, 1), intensity.swapaxes(0, 1)
    return state


def assert_states_agree(fast: np.ndarray, slow: np.ndarray, shape: tuple[int, int], points: int = 10):
    """But for ties both have the same points, and all fields of each agree."""
    fast, slow = (maps.crop(a, *shape).astype(np.float64) for a in (fast, slow))
    here, there = (a[:, :, maps.INTENSITY] > 0 for a in (fast, slow))
    wrong = here != there
    assert (fast[:, :, maps.DEPTH] >= 0).all() and (fast[:, :, maps.DEPTH] <= T).all()  # T: −ε, rounded
    for field in range(maps.FIELDS):
        one, other = (state[:, :, field][here & there] for state in (fast, slow))
        error = np.abs(circular_difference(one, other, T) if field == maps.DEPTH else one - other)
        if field in (maps.DEPTH, maps.SLOPE_COL, maps.SLOPE_ROW):
            tolerance = DEPTH_TOLERANCE
        else:
            least = DEPTH_TOLERANCE if field == maps.RESIDUAL else 1e-6         # a root of differences
            tolerance = RELATIVE * np.abs(other) + least
        wrong[here & there] |= ~(error <= tolerance)
        assert (error <= FARTHEST_AT_TIES * tolerance).all(), (field, error.max())
    assert here.sum() >= points and wrong.sum() <= here.sum() * SHARE_AT_TIES, np.argwhere(wrong)


def assert_clouds_agree(one: PointCloud, other: PointCloud, surfaces: int, points: int):
    """But for ties no point differs by what a user could notice, and half of them by next to nothing."""
    for k in range(surfaces):
        depth, intensity, std = ([cloud.image(field, k) for cloud in (one, other)]
                                 for field in ("depth_bins", "intensity", "depth_std_bins"))
        wrong = np.isfinite(depth[0]) != np.isfinite(depth[1])
        there = np.isfinite(depth[0]) & np.isfinite(depth[1])
        errors = circular_difference(*depth, T) / std[1], np.diff(intensity, axis=0)[0] / np.sqrt(intensity[1])
        for error in (*errors, std[0] / std[1] - 1):
            wrong |= there & ~(np.abs(error) <= NOISE_PART)
            assert np.median(np.abs(error[there])) <= TYPICAL
        assert there.sum() > points / (k + 1) and wrong.sum() <= max(there.sum() * SHARE_AT_TIES, 1), np.argwhere(wrong)
    noise = np.sqrt(np.maximum(other.background, 1))
    assert (np.abs(one.background - other.background) <= NOISE_PART * noise).all()
