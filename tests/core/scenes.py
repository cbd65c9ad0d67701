"""Sensors, scenes and photons that the tests of the methods share."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from srt3d_ros.core.method.matched_frame import MatchedFrame, Matcher, SensorOnDevice
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import angular_frequencies, choose_frequencies, irf_spectrum
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.kernels import maps

T = 586
IRF = np.exp(-0.5 * ((np.arange(40) - 15) / np.where(np.arange(40) < 15, 3, 5))**2)     # steep rise, slow decay


def make_sensor(rows: int, cols: int, **changes) -> SensorModel:
    return SensorModel(rows, cols, **({"num_bins": T, "bin_width_s": 16e-12, "irf": IRF} | changes))


def ramp(rows: int, cols: int, start: float, per_col: float, per_row: float) -> np.ndarray:
    y, x = np.mgrid[:rows, :cols]
    return start + per_col * x + per_row * y


def simulate(depth_bins: np.ndarray, sbr: float, ppp: float, sensor=None, seed=0) -> PhotonEvents:
    """Photons of surfaces at these depths, [rows, cols] or [S, rows, cols]."""
    sensor = sensor or make_sensor(*depth_bins.shape[-2:])
    return Simulator(StaticScene(sensor.range_m(depth_bins)), sensor, sbr=sbr, ppp=ppp, seed=seed).frame(0)[0]


def drawn(scene: list[tuple], background: float, sigma: float, seed: int, num_bins: int = 1000, width: float = 1.0,
          **options) -> PointCloud:
    """The cloud of surfaces (depths [rows, cols], photons a pixel), pulses of `sigma` bins, and an even background.

    The sensor takes its IRF for `width` times as wide as it is.
    """
    rng, shape, size = np.random.default_rng(seed), scene[0][0].shape, scene[0][0].size
    seen = []
    for depth, photons in scene:
        pixel = np.repeat(np.arange(size), rng.poisson(np.broadcast_to(photons, shape).ravel()))
        seen.append((pixel, np.rint(depth.ravel()[pixel] + sigma * rng.standard_normal(len(pixel)))))
    number = rng.poisson(background * size)
    seen.append((rng.integers(0, size, number), rng.integers(0, num_bins, number)))
    pixel, toa = (np.concatenate(parts) for parts in zip(*seen))
    at = np.arange(-int(6 * sigma * width), int(6 * sigma * width) + 1)
    sensor = SensorModel(*shape, num_bins, 1e-11, np.exp(-at**2 / (2 * (sigma * width)**2)))
    return reconstruct("pooled", PhotonEvents(pixel.astype(np.uint32), toa.astype(np.uint16)), sensor,
                       choose_frequencies("auto", sensor), **options)


def exact(sensor: SensorModel, depth_bins: np.ndarray, signal=20.0, frequencies=None) -> PhaseSums:
    """The expected sketch of surfaces at these depths as every pixel sees them, without the noise of photons."""
    frequencies = frequencies or choose_frequencies("auto", sensor)
    gain = np.ones((sensor.rows, sensor.cols)) if sensor.gain is None else sensor.gain
    turned = np.exp(1j * angular_frequencies(frequencies, sensor.num_bins) * (depth_bins + sensor.late)[..., None])
    spectrum = irf_spectrum(sensor, frequencies)
    response = spectrum if spectrum.ndim == 1 else spectrum.reshape(turned.shape)
    sums = (gain * signal)[..., None] * response * turned
    return PhaseSums(frequencies, sums.astype(np.complex64), np.rint(gain * signal).astype(np.uint32), 3, sensor=sensor)


def background_alone(sensor: SensorModel, ppp: float, seed: int = 0) -> PhotonEvents:
    """Photons spread as the sensor's background_shape says."""
    rng = np.random.default_rng(seed)
    count = rng.poisson(ppp * sensor.pixels)
    pixel = np.sort(rng.integers(0, sensor.pixels, count)).astype(np.uint32)
    if sensor.background_shape is None:
        return PhotonEvents(pixel, rng.integers(0, sensor.num_bins, count).astype(np.uint16))
    cumulative = np.cumsum(sensor.background_shape, dtype=np.float64)
    toa = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    return PhotonEvents(pixel, toa.astype(np.uint16))


def with_photons(frame: PhotonEvents, pixel: np.ndarray, toa) -> PhotonEvents:
    """The frame with further photons in these pixels."""
    toa = np.broadcast_to(toa, len(pixel)).astype(np.uint16)
    return PhotonEvents(np.append(frame.pixel, pixel.astype(np.uint32)), np.append(frame.toa, toa))


def reconstruct(name: str, frame: PhotonFrame, sensor: SensorModel, frequencies, **options) -> PointCloud:
    """The cloud of photons by the method of this name, by way of their sketch if it needs no more."""
    method = METHODS[name].build(sensor, frequencies, **options)
    return method(sketch_photons(frame, sensor, frequencies) if METHODS[name].needs == "sketch" else frame)


def run(name: str, frame, sensor: SensorModel, sketch_size: int = 10, **options):
    """The cloud by a method with its own frequencies, of photons or their sketch."""
    m = min(sketch_size, max((sensor.num_bins - 1) // 2, 1))
    frequencies = choose_frequencies(METHODS[name].frequencies, sensor, m)
    if isinstance(frame, PhaseSums):
        return METHODS[name].build(sensor, frequencies, **options)(frame)
    return reconstruct(name, frame, sensor, frequencies, **options)


def pooled(frame, sensor: SensorModel, sketch_size: int = 10, **options):
    return run("pooled", frame, sensor, sketch_size, **options)


def errors(cloud, depth_bins) -> np.ndarray:
    """Of each point from the depth of its pixel, or from the nearest of several depths of the scene; bins."""
    depth_bins = np.asarray(depth_bins)
    truth = depth_bins[cloud.row, cloud.col][:, None] if depth_bins.ndim == 2 else depth_bins[None]
    difference = circular_difference(cloud.depth_bins[:, None].astype(np.float64), truth, T)
    return difference[np.arange(len(difference)), np.abs(difference).argmin(axis=1)]


def through(stamped: Iterable[tuple[int, Pose]]) -> Trajectory:
    """The trajectory of these stamps [ns] and poses."""
    trajectory = Trajectory()
    for stamp_ns, pose in stamped:
        trajectory.add(stamp_ns, pose)
    return trajectory


def assert_same_sketch(one: PhaseSums, other: PhaseSums, each: float = 1e-6):
    """The same photons, and sums that differ by at most `each` a photon."""
    np.testing.assert_array_equal(one.photons, other.photons)
    assert (np.abs(one.sums - other.sums) <= each * np.maximum(one.photons, 1)[..., None]).all()


def assert_finite(cloud, num_bins: int = T):
    for name in ("depth_bins", "intensity", "xyz", "background"):
        assert np.isfinite(getattr(cloud, name)).all(), name
    std = cloud.depth_std_bins              # NaN of the baselines
    assert (np.isfinite(std) & (std > 0)).all() or np.isnan(std).all()
    assert (cloud.intensity > 0).all() and (cloud.background >= 0).all()
    assert (cloud.depth_bins >= 0).all() and (cloud.depth_bins < num_bins).all()


def matched_frame(sensor: SensorModel, sketch: PhaseSums) -> MatchedFrame:
    """The frame of a sketch as the CPU's kernels get it, but for the padding of its maps."""
    matcher = Matcher(sensor, sketch.frequencies)
    matcher.check(sketch)
    frame, _ = SensorOnDevice(matcher, "cpu", 1).match(sketch.photons.astype(np.float32), sketch.sums)
    matched, counts = (maps.crop(each, *frame.shape).copy() for each in (frame.matched, frame.counts))
    return replace(frame, matched=matched, counts=counts, exposure=sensor.exposure)
