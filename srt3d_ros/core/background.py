"""Backgrounds that do not spread evenly over the bins: known or estimated, and subtracted from the sketch.

B background photons that spread over the bins like β(b) add B·β̂_l to the sums of a sketch, with
β̂_l = Σ_b β(b) exp(i ω_l x_b) and x_b the centre of bin b; evenly spread ones add nothing in expectation. Fog before the
scene, a dead time, or a gate that opens slowly give such backgrounds.
"""

from dataclasses import dataclass, replace

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.frequencies import angular_frequencies
from srt3d_ros.core.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.photons import PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require
from srt3d_ros.kernels.maps import window_weights

BACKGROUNDS = ("sensor", "flat", "estimate")
CELL = 4                    # pixels: size of the cells in which photons are pooled
POOL = (window_weights(4.0 / CELL), CELL)
SURE = 7.0                  # standard deviations above which a cell's peak is a surface, not background
ROUNDS = 4                  # of surfaces and background, each estimated from what the other leaves
SHARPEST = 3                # surfaces that an even wall or two may add to the mean of all pixels
MUCH_LESS = 0.8             # of what one estimate leaves unexplained, to prefer the other
UNEXPLAINED = 0.3           # share of the signal that may pass for background: bright frames keep a flat one
COHERENT = 0.5              # share of the energy at high frequencies that one surface must explain
HOT = 10.0                  # times the median of the pixels: a dark frame's pixels above it are not counted


class Background:
    """Subtracts the background's part from frames.

    Args:
        matcher: of the frames.
        kind: "sensor": spread as the sensor's background_shape says, evenly if it says nothing; "flat": evenly,
            whatever it says; "estimate": as each frame itself shows.
    """

    def __init__(self, matcher: Matcher, kind: str = "sensor"):
        require(kind in BACKGROUNDS, "background", kind, " or ".join(BACKGROUNDS))
        self._omega = angular_frequencies(matcher.frequencies, matcher.sensor.num_bins)
        shape = matcher.sensor.background_shape if kind == "sensor" else None
        self._estimates = kind == "estimate"
        self._matched = None if shape is None else _matched(matcher, shape, self._omega)
        self.clutter = None if shape is None else _clutter(matcher, shape, self._omega)

    @property
    def is_flat(self) -> bool:
        """Whether there is nothing to remove."""
        return self._matched is None and not self._estimates

    def remove(self, frame: MatchedFrame) -> MatchedFrame:
        """The frame with a background that is flat in expectation; the same one if it is so already."""
        if self.is_flat:
            return frame
        _, kernels = kernels_for("cpu")         # cells are few: whatever the device, this runs beside it
        cells = _Cells.of(frame, kernels)
        frame, matched = replace(frame, clutter=self.clutter), self._matched
        if self._estimates:
            matched = self._estimate(frame, cells, kernels)[None, :, None]
        common = matched.shape[0] == matched.shape[2] == 1
        every = cells.photons * matched if common else kernels.blur(frame.counts[:, None] * matched, *POOL)
        signal = np.zeros_like(cells.photons)
        for _ in range(2):              # the second time without what the first took for background
            _, signal = _surfaces(frame, cells, every, signal, kernels)
        share = 1 - (signal / np.maximum(cells.photons, 1e-6))[:, 0]
        rows, cols = (np.arange(size) // CELL for size in frame.shape)
        background = frame.counts * share[np.ix_(rows, cols)]
        return replace(frame, matched=frame.matched - background[:, None] * matched)

    def _estimate(self, frame: MatchedFrame, cells: "_Cells", kernels) -> np.ndarray:
        """What each background photon adds to `matched` on average, float32 [2m]: Σ (matched − surfaces) / Σ B.

        The start is the mean of all photons: once without what is too sharp to be background, as a wall that fills the
        view is, and once with that, for the edge of a gate may be sharp. The second is right if it leaves much less
        unexplained and has not taken all surfaces for background.
        """
        every = cells.matched.sum(axis=(0, 2)) / max(cells.photons.sum(), 1e-6)
        (mean, rest, _), (other, other_rest, seen) = (self._alternate(frame, cells, start, kernels) for start in (
            _without_sharp(every, frame, self._omega), every))
        return (other if other_rest < MUCH_LESS * rest and seen > 0.5 else mean).astype(np.float32)

    def _alternate(self, frame: MatchedFrame, cells: "_Cells", mean: np.ndarray,
                   kernels) -> tuple[np.ndarray, float, float]:
        """Surfaces and background in turn, from `mean`, what a background photon adds at first.

        Returns:
            What a background photon adds; Σ |rest|² over its variance; the share of cells with a surface.
        """
        signal = np.zeros_like(cells.photons)
        variance = np.maximum(np.tile(frame.energy, 2)[:, None] * cells.counts, 1e-6)
        for _ in range(ROUNDS):
            depth, signal = _surfaces(frame, cells, cells.photons * mean[:, None], signal, kernels)
            rest = cells.matched - signal * _steered(frame.energy, self._omega, depth)
            background = cells.photons - signal
            mean = rest.sum(axis=(0, 2)) / max(background.sum(), 1e-6)
        unexplained = float(((rest - background * mean[:, None])**2 / variance).sum())
        mean = mean / (1 + (UNEXPLAINED * signal.sum() / max(background.sum(), 1e-6))**2)
        return mean, unexplained, float((signal > 0).mean())


def dark_shape(frame: PhotonFrame, sensor: SensorModel) -> np.ndarray:
    """background_shape of a sensor, float32 [T], from photons recorded without the laser's echo: their histogram.

    Each pixel's photons count from its delay; masked pixels and hot ones are left out. No smoothing is needed: a sketch
    sees low frequencies alone, and N photons give each of these with a standard deviation of 1/√(2N).

    Raises:
        InvalidInput: photons outside the sensor, or none that count.
    """
    events = frame.to_events(sensor) if isinstance(frame, PhotonGates) else frame
    events.check(sensor)
    counts = np.bincount(events.pixel, minlength=sensor.pixels)
    used = counts <= HOT * max(np.median(counts), 1)
    if sensor.mask is not None:
        used &= sensor.mask.reshape(-1)
    kept = used[events.pixel]
    late = 0 if sensor.delay_bins is None else sensor.delay_bins.reshape(-1)[events.pixel[kept]]
    bins = sensor.toa_bins(sensor.toa_positions(events.toa[kept]) - late)
    require(len(bins) > 0, "dark frame", "no photons", "photons in pixels that are not masked")
    histogram = np.bincount(bins, minlength=sensor.num_bins)
    return (histogram / histogram.sum()).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Cells:
    """Pools of a frame: matched [R, 2m, C], photons Σ w n and counts Σ w² n, both [R, 1, C]."""

    matched: np.ndarray
    photons: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, frame: MatchedFrame, kernels) -> "_Cells":
        photons, (weights, step) = frame.counts[:, None], POOL
        return cls(kernels.blur(frame.matched, weights, step), kernels.blur(photons, weights, step),
                   kernels.blur(photons, weights**2, step))


def _surfaces(frame: MatchedFrame, cells: _Cells, every: np.ndarray, signal: np.ndarray,
              kernels) -> tuple[np.ndarray, np.ndarray]:
    """Depth and photons of the surface of every cell, 0 photons where there is none for sure.

    Args:
        every: what the photons of each cell would add to `matched` if they all were background.
        signal: photons that are not, as far as known.
    """
    rest = cells.matched - (1 - signal / np.maximum(cells.photons, 1e-6)) * every
    depth, _ = kernels.match(rest.astype(np.float32), frame.energy, frame.bin_frequencies, frame.num_bins, 1)
    depth, found = _sharpened(frame, rest, depth)
    score = found * np.sqrt(2 * frame.total_energy / np.maximum(cells.counts, 1e-6)) / frame.noise_ratio(depth)
    return depth, np.where(score > SURE, np.clip(found, 0, cells.photons), 0)


def _sharpened(frame: MatchedFrame, rest: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depths after two Newton steps, and their intensities; an error of the filter's grid would pass for background."""
    m = len(frame.energy)
    omega = 2 * np.pi * frame.bin_frequencies[:, None]
    for last in (False, False, True):
        along = (rest[:, :m] + 1j * rest[:, m:]) * np.exp(-1j * omega * depth)
        if not last:
            bend = (omega**2 * along.real).sum(axis=1, keepdims=True)
            step = (omega * along.imag).sum(axis=1, keepdims=True) / np.maximum(bend, 1e-6)
            depth = depth + np.clip(step, -frame.resolution_bins, frame.resolution_bins)
    return depth, along.real.sum(axis=1, keepdims=True) / frame.total_energy


def _matched(matcher: Matcher, shape: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """What a background photon adds to `MatchedFrame.matched` on average, float32 [rows or 1, 2m, cols or 1]."""
    sums = np.exp(1j * np.outer(omega, np.arange(len(shape)) + matcher.sensor.first_bin_center)) @ shape
    late = matcher.sensor.delay_bins
    if late is not None:
        sums = sums * np.exp(1j * omega * late[..., None])
    return matcher.matched(np.atleast_3d(sums).reshape(*(late.shape if late is not None else (1, 1)), -1))


def _clutter(matcher: Matcher, shape: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """`MatchedFrame.clutter`: √(variance of a background photon's response at each bin / its variance if even)."""
    spectrum = matcher.spectrum
    centers = np.arange(len(shape)) + matcher.sensor.first_bin_center
    response = (np.exp(1j * np.outer(centers, omega)) @ np.conj(spectrum)).real
    spread = np.fft.rfft(shape)
    mean, square = (np.fft.irfft(np.conj(np.fft.rfft(values)) * spread, len(shape))
                    for values in (response, response**2))
    return np.sqrt(np.maximum((square - mean**2) / (np.square(np.abs(spectrum)).sum() / 2), 1)).astype(np.float32)


def _without_sharp(mean: np.ndarray, frame: MatchedFrame, omega: np.ndarray) -> np.ndarray:
    """The mean sketch of all photons without surfaces that many pixels see at one depth.

    The upper half of the frequencies shows them: there a background that changes slowly has died away. Strongest first,
    as long as one alone explains half of the energy there.
    """
    m = len(omega)
    upper, energy = slice(m // 2, m), frame.energy.astype(np.float64)
    depth = np.arange(0, frame.num_bins, np.pi / (4 * omega.max()))
    steering = np.exp(1j * np.outer(depth, omega[upper]))
    rest = mean[:m] + 1j * mean[m:]
    total = energy[upper].sum()
    for _ in range(SHARPEST):
        response = (np.conj(steering) @ rest[upper]).real / total
        top = response.argmax()
        seen = (np.abs(rest[upper])**2 / np.maximum(energy[upper], 1e-12)).sum()
        if response[top] <= 0.01 or response[top]**2 * total < COHERENT * seen:
            break
        rest = rest - response[top] * energy * np.exp(1j * omega * depth[top])
    return np.concatenate([rest.real, rest.imag])


def _steered(energy: np.ndarray, omega: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """What one signal photon from each depth, [R, 1, C], adds to `matched`, [R, 2m, C]."""
    turned = energy[:, None] * np.exp(1j * omega[:, None] * depth)
    return np.concatenate([turned.real, turned.imag], axis=1)
