"""FreeSpace: how far pixels without a point are empty (docs/algorithm.md, "Empty space").

A surface that sends r_min photons into a pixel would have been found; so where nothing was found, nothing that bright
is there. An object sends A / R² photons from R metres, A at 1 m: as R grows, it falls below r_min, and the claim ends.
"""

from collections.abc import Sequence

import numpy as np

from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.errors import require
from srt3d_ros.kernels.constants import EPSILON, START_SCORE
from srt3d_ros.kernels.maps import window_weights

SAFETY = 2.0            # times r_min; at 1, up to 8 % of the pixels of poles claimed emptiness behind them
NEAR = 2                # pixels within which a point ends a claim: outlines of objects at r_min are not found
QUANTILE = 1.645        # σ by which the expected score exceeds the start's, to reach it in 95 of 100 frames
SIZE = 5                # pixels along the side of the object that r_min is for
SIGMAS = 1.0, 3.0       # pixels, of the means of photons; the larger counts, because bright things beside hide dim ones
BOX = 7                 # pixels along the side
NEAREST_M = 0.3         # beginning of the period or gate, above which the space before it is unseen
NOISE = 1.3             # of photons as large as their number; more, if background was subtracted from that
SAMPLE = 500            # pairs of pixels that tell
STEPS_PER_NAT = 128     # of the table of r_min: claims are at most 0.4 % too short
NATS = -14, 22          # logarithms of the fewest and of the most photons in a pixel
HALVINGS = 7            # of the interval of ranges that pile-up leaves


class FreeSpace:
    """Tells how far the pixels of a sensor are empty, each frame by itself: a dead pixel counts as a dark one.

    Args:
        sensor, frequencies: of the sketches.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int]):
        from scipy import ndimage  # here: slow, and few need it

        self._filters, self._sensor = ndimage, sensor
        used = self._used = sensor.used.astype(np.float32)
        self._seen = [np.maximum(share, EPSILON) for share in self._means(used)]
        share = np.minimum(ndimage.gaussian_filter(sensor.exposure, SIGMAS[0]), sensor.exposure)
        self._share = np.maximum(share, EPSILON)
        self._least = least_intensities(Matcher(sensor, frequencies))
        bins, (first, last) = sensor.histograms, (0.0, float(sensor.num_bins))
        if bins is not None:
            first, last = bins.first_bin, min(bins.first_bin + bins.num_bins * bins.bin_width, last)
        self._begin_m, self._end_m = map(float, sensor.range_m([first, last]))
        self._sees_near = self._begin_m <= NEAREST_M and (bins is None or bins.template is None)

    def range_m(self, sketch: PhaseSums, cloud: PointCloud, brightness: float, max_range_m: float = 0.0) -> np.ndarray:
        """The range up to which each pixel holds no object of `brightness` or more.

        That of objects of 3 × 3, 2 × 5 or 1 × 30 pixels on: at most 5 % of their pixels claim more. The claim ends
        where S(R) N (1 − exp(−A g / (N R²))) / g falls to 2 r_min: N cycles, S survival of the photons that come before
        in a cycle (both only where cycles are known), g exposure; and at any point within 2 pixels.

        Args:
            sketch: of the frame.
            cloud: that `pooled` made of it alone, not of a window, with all its points.
            brightness: A, signal photons of the object's pixel in the frame at 1 m.
            max_range_m: no claim exceeds it; 0 = no limit but the end of the period or gate.

        Returns:
            float32 [rows, cols], metres; NaN where a pixel has a point or is masked. All NaN if background was
            subtracted from the photons, or if period or gate begin beyond 0.3 m.

        Raises:
            InvalidInput: the brightness is not above 0, or the cloud is not of this sketch.
        """
        require(np.isfinite(brightness) and brightness > 0, "brightness", brightness, "above 0 photons a frame at 1 m")
        require(cloud.clutter is not None and cloud.background.shape == sketch.photons.shape, "cloud",
                problem="cloud: expected one that pooled has reconstructed from this sketch.")
        nearest = self._nearest(cloud)
        free = np.full(nearest.shape, np.nan, np.float32)
        open_ = np.isinf(nearest) & self._sensor.used
        if not self._sees_near or _is_subtracted(sketch, open_):
            return free
        most, end_m = self._most_photons(sketch.photons), self.end_m(max_range_m)
        least = SAFETY * self._least_intensity(most, cloud.clutter or 1.0) / self._share
        claim = (self._piled_up(least, brightness, sketch, most, end_m) if sketch.cycles
                 else np.minimum(np.sqrt(np.float32(brightness) / least), end_m))
        claim = np.minimum(claim, of_square(np.minimum, nearest, NEAR))
        return np.where(open_ & (claim > self._begin_m), claim, free)

    def end_m(self, max_range_m: float = 0.0) -> np.float32:
        """The end of the longest claims, metres."""
        return np.float32(min(self._end_m, max_range_m or np.inf))

    def _nearest(self, cloud: PointCloud) -> np.ndarray:
        """Range of each pixel's nearest point, float32 [rows, cols]; Inf without one."""
        nearest = np.full(cloud.background.shape, np.inf, np.float32)
        np.minimum.at(nearest, (cloud.row, cloud.col), self._sensor.range_m(cloud.depth_bins).astype(np.float32))
        return nearest

    def _most_photons(self, photons: np.ndarray) -> np.ndarray:
        """Photons of a pixel, of all kinds: the largest local mean plus two standard deviations; float32."""
        means = self._means(photons.astype(np.float32) * self._used)
        # n has the standard deviation √(n / a), a = 4π σ² the pixels in the mean: n + 2 √(n / a) + 1 / a is a square
        roots = [np.sqrt(np.maximum(mean, 0) / seen) + np.float32(1 / np.sqrt(4 * np.pi * sigma**2))
                 for sigma, mean, seen in zip(SIGMAS, means, self._seen)]
        return np.square(np.maximum(*roots))

    def _means(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means by SIGMAS around each pixel; two boxes, of variance 4 each, make the second of the first."""
        near = self._filters.gaussian_filter(values, SIGMAS[0])
        return near, self._filters.uniform_filter(self._filters.uniform_filter(near, BOX), BOX)

    def _least_intensity(self, photons: np.ndarray, clutter: float) -> np.ndarray:
        """r_min(n, c) = c² r_min(n / c², 1): clutter c lowers scores c times; at a given r / n they grow with √n."""
        place = (np.log(photons / np.float32(clutter**2)) - NATS[0]) * STEPS_PER_NAT + 1        # the next larger
        return np.float32(clutter**2) * self._least[np.clip(place, 0, len(self._least) - 1).astype(np.int32)]

    def _piled_up(self, least: np.ndarray, brightness: float, sketch: PhaseSums, photons: np.ndarray,
                  end_m: np.float32) -> np.ndarray:
        """The largest R with S(R) N (1 − exp(−A g / (N R²))) / g ≥ least; S = exp(−Λ t(R) / T), Λ by `pile_up`.

        S(R) of a range tells a range that is seen: one that is too near if R is too far, and the other way round.
        After a long dead time, N is without the cycles that photons cost, and S = 1.
        """
        sensor, g = self._sensor, np.maximum(self._sensor.exposure, EPSILON)
        cycles = np.maximum(sketch.armed_cycles - sensor.dead_time.cycles * photons, EPSILON).astype(np.float32)
        flux = -np.log1p(-np.minimum(photons / (cycles + 0.5), 1 - EPSILON)) * (sensor.dead_time.periods == 0)
        light, least = np.float32(brightness / sketch.cycles) * g, least * g / cycles

        def seen_to(range_m: np.ndarray) -> np.ndarray:
            time = np.clip((sensor.depth_bins(range_m) + sensor.late) / sensor.num_bins, 0, 1)
            with np.errstate(divide="ignore"):      # never seen: 0 m
                return np.sqrt(light / -np.log1p(-np.minimum(least * np.exp(flux * time), 1)))

        high = np.full_like(least, end_m)
        low = np.minimum(seen_to(high), high)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            other = seen_to(middle)
            low, high = np.maximum(low, np.minimum(middle, other)), np.minimum(high, np.maximum(middle, other))
        return low


def least_intensities(matcher: Matcher) -> np.ndarray:
    """r_min of b = exp(NATS[0]), … exp(NATS[1]) background photons a pixel, in steps of 1 / STEPS_PER_NAT; float32.

    The search's window w of σ = 1 pixel lies on an object of 5 × 5 pixels with r signal photons each. It has
    N = b Σw² + r Σ_object w² and, w being Gaussian, p = 2 N; V = r E Σ_object w. With u = V / p the score is
    2 √N ρ(u) (docs/algorithm.md), so each u gives N for the score that is wanted, and N gives r and b.
    """
    side = window_weights(1.0)
    inside = np.abs(np.arange(len(side)) - len(side) // 2) <= SIZE // 2
    on, squares, full = side[inside].sum()**2, (side[inside]**2).sum()**2, (side**2).sum()**2
    energy, response, table = (matcher.constants[name] for name in (
        "total_energy", "max_response", "background_table"))
    # no u is larger: there b is 0, or all photons respond alike
    u = np.geomspace(1e-6, min(on * energy / (2 * squares * response), 1), 500)[:-1]
    rho = np.interp(u * (len(table) - 1), np.arange(len(table)), table)
    n = ((START_SCORE + QUANTILE) / (2 * rho))**2
    r = 2 * n * u * response / (on * energy)
    nats = np.arange(NATS[0] * STEPS_PER_NAT, NATS[1] * STEPS_PER_NAT + 1) / STEPS_PER_NAT
    return np.exp(np.interp(nats, np.log((n - squares * r) / full)[::-1], np.log(r)[::-1])).astype(np.float32)


def of_square(combine: np.ufunc, values: np.ndarray, reach: int) -> np.ndarray:
    """`combine` of each pixel and those around, up to `reach` rows and columns away, within the image."""
    for _ in range(2):
        lines = np.ascontiguousarray(values.T)
        values = lines.copy()
        for k in range(1, reach + 1):
            combine(values[k:], lines[:-k], out=values[k:])
            combine(values[:-k], lines[k:], out=values[:-k])
    return values


def _is_subtracted(sketch: PhaseSums, quiet: np.ndarray) -> bool:
    """Whether sums vary more than so many photons do, because background was subtracted; or nothing tells.

    The sums of quiet neighbours differ by the noise of their photons, |difference|² = n₁ + n₂ on average.
    """
    photons, sums, quiet = sketch.photons.ravel().astype(np.float32), sketch.sums.reshape(quiet.size, -1), quiet.ravel()
    pairs = photons[1:] + photons[:-1]
    at = np.flatnonzero(quiet[1:] & quiet[:-1] & (pairs > 0))
    at = at[::len(at) // SAMPLE + 1]
    apart = (sums[at + 1] - sums[at]).view(np.float32)      # real and imaginary parts
    noise = 2 * np.square(apart).mean(axis=1) / pairs[at]
    return bool(2 * np.count_nonzero(noise > NOISE) >= len(at))
