"""Simulate photons of a scene by the observation model of the SRT3D paper, with the true depths."""

import numpy as np

from srt3d_ros.core.sensor.dead_time import DeadTime
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.bust import Bust
from srt3d_ros.datasets.simulation.scene import Scene, default_sensor
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import require

QUANTILES = 2**16


class Simulator:
    """A sensor looking at a scene; frame k starts at k / frame_rate_hz.

    The photons of pixel (i, j) are a Poisson process over the T bins (Tachella, Sheehan and Davies, ICASSP 2022,
    eq. 1 and 2, with the gain of RT3D): Σ_k r_ijk h(x − t_ijk) + b, times the pixel's gain, wrapped modulo T, with
    the IRF h of sum 1, `irf[irf_ref]` on the depth. Depths fall between bins: h is then shifted by linear
    interpolation. r is the scene's reflectivity times a constant; the background b is uniform over pixels, and over
    bins unless the sensor has a background_shape.

    That constant and b are set on frame 0, over the pixels inside the sensor's mask:
        ppp = mean over pixels of the expected photons per frame, signal and background together;
        sbr = expected signal photons / expected background photons, summed over all pixels and bins.
    A scene that later moves nearer or brightens gives more photons, as with a real sensor.

    If the sensor has `cycles`, each photon falls into a random one, and a pixel detects only the first photon of a
    cycle, or, with a `dead_time_s` of a period or longer, those after it: fewer than `ppp`.

    Args:
        scene: by default `Bust`, the moving head and shoulders.
        sensor: by default `default_sensor()`. Masked pixels give no photons.
        sbr: above 0, or infinite for no background.
        seed: with the other arguments and k, it determines frame k.

    Raises:
        InvalidInput: naming the argument that cannot be used.
    """

    def __init__(self, scene: Scene | None = None, sensor: SensorModel | None = None, sbr: float = 1.0,
                 ppp: float = 10.0, seed: int = 0, frame_rate_hz: float = 10.0):
        require(sbr > 0, "sbr", sbr, "a ratio above 0")
        require(0 <= ppp < np.inf, "ppp", ppp, "photons per pixel, 0 or more")
        require(seed == int(seed) and seed >= 0, "seed", seed, "an integer of 0 or more")
        require(0 < frame_rate_hz < np.inf, "frame_rate_hz", frame_rate_hz, "a rate above 0 Hz")
        self.sensor = default_sensor() if sensor is None else sensor
        self._scene = Bust(self.sensor) if scene is None else scene
        self._seed, self._frame_rate_hz = int(seed), frame_rate_hz
        pixels = self.sensor.pixels
        require(ppp * pixels <= MAX_EVENTS, "ppp", ppp, f"at most {MAX_EVENTS} photons in a frame of {pixels} pixels")
        self._gain = self.sensor.exposure.astype(np.float64)
        self._draw_irf = _IrfSampler(self.sensor.irf)
        _, relative = self._look(0)
        used = max(np.count_nonzero(self._gain), 1)
        background_share = 1 / (1 + sbr)
        mean_signal = (relative * self._gain).sum() / used
        require(mean_signal > 0 or ppp == 0, "scene", problem="The scene reflects nothing in frame 0.")
        self._brightness = ppp * (1 - background_share) / mean_signal if ppp else 0.0
        self._background = ppp * background_share * used / max(self._gain.sum(), 1e-30)

    def frame(self, k: int) -> tuple[PhotonEvents, np.ndarray]:
        """Photons of frame k, sorted by pixel and stamped k / frame_rate_hz, and the true depths.

        Depths are float32 [S, rows, cols], bins in [0, T), NaN = no surface.
        """
        depth, signal, background = self.expected(k)
        random = np.random.default_rng([self._seed, k])
        events = self._draw(depth, signal, background, random)
        if self.sensor.cycles:
            events = first_of_cycle(*events, self.sensor.cycles, random, self.sensor.dead_time)
        stamp_ns = round(k * 1e9 / self._frame_rate_hz)
        return PhotonEvents(*events, stamp_ns), depth

    def expected(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depths as from `frame`, expected photons of each return [S, rows, cols], of the background [rows, cols]."""
        depth, relative = self._look(k)
        return depth, relative * self._gain * self._brightness, self._gain * self._background

    def _look(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Depth (bins, NaN = none) and reflectivity (0 where none) at frame k."""
        sensor = self.sensor
        range_m, reflectivity = self._scene.frame(k / self._frame_rate_hz)
        shape = (sensor.rows, sensor.cols)
        require(range_m.ndim == 3 and range_m.shape[1:] == shape and reflectivity.shape == range_m.shape, "scene shape",
                f"{range_m.shape} and {reflectivity.shape}", f"[S, {sensor.rows}, {sensor.cols}], the sensor's pixels")
        seen = np.isfinite(range_m)
        along_m = np.where(seen, range_m, np.nan).astype(np.float64)
        depth = sensor.wrapped(sensor.depth_bins(along_m))
        require(bool((reflectivity[seen] >= 0).all()), "reflectivity", problem="Some reflectivity is negative or NaN.")
        return depth, np.where(seen, reflectivity, 0)

    def _draw(self, depth: np.ndarray, signal: np.ndarray, background: np.ndarray,
              random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Pixel and ToA of a frame's photons, sorted by pixel, then by surface, background last."""
        sensor, surfaces = self.sensor, len(depth)
        rates = np.concatenate([signal, background[None]]).reshape(surfaces + 1, -1).T
        counts = random.poisson(rates)
        pixel = np.repeat(np.arange(sensor.pixels, dtype=np.uint32), counts.sum(axis=1))
        # ToA = floor(start of the IRF + a draw from it); background photons start at NaN and are drawn below.
        starts = np.full((sensor.pixels, surfaces + 1), np.nan, np.float32)
        starts[:, :surfaces] = (depth + sensor.late - sensor.irf_ref).reshape(surfaces, -1).T
        start = np.repeat(starts.ravel(), counts.ravel())
        toa = self._draw_irf(pixel, random)
        toa += start
        stray = np.flatnonzero(np.isnan(start))
        toa[stray] = self._draw_background(pixel[stray], random)
        bins = np.floor(toa).astype(np.int32)
        bins %= sensor.num_bins
        return pixel, bins.astype(np.uint16)

    def _draw_background(self, pixel: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """ToA of background photons in bins, not yet wrapped."""
        sensor = self.sensor
        if sensor.background_shape is None:
            return random.integers(0, sensor.num_bins, len(pixel))
        cumulative = np.cumsum(sensor.background_shape, dtype=np.float64)
        bins = np.searchsorted(cumulative, random.random(len(pixel)) * cumulative[-1], side="right")
        return bins + random.random(len(pixel)) + sensor.late.reshape(-1)[pixel]


def first_of_cycle(pixel: np.ndarray, toa: np.ndarray, cycles: int, random: np.random.Generator,
                   dead: DeadTime | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The photons of pixels that detect only the first one in each laser cycle, or after a long dead time, sorted."""
    cycle = random.integers(0, cycles, len(pixel))
    order = np.lexsort((toa, cycle, pixel))
    pixel, toa, cycle = pixel[order], toa[order], cycle[order]
    first = (np.diff(pixel.astype(np.int64), prepend=-1) != 0) | (np.diff(cycle, prepend=-1) != 0)
    if dead is None or not dead.periods:
        return pixel[first], toa[first]
    bins = dead.periods * dead.period + dead.rest
    at = (pixel.astype(np.int64) * (cycles + dead.periods + 2) + cycle) * dead.period + toa
    photon, detected = np.flatnonzero(np.diff(pixel.astype(np.int64), prepend=-1)), []
    while len(photon):
        detected.append(photon)
        after = np.searchsorted(at, at[photon] + bins)
        photon = after[pixel[np.minimum(after, len(at) - 1)] == pixel[photon]]
        photon = photon[photon < len(at)]
    kept = np.sort(np.concatenate(detected)) if detected else photon
    return pixel[kept], toa[kept]


class _IrfSampler:
    """Draw times in bins from the density irf[j] over [j, j + 1)."""

    def __init__(self, irf: np.ndarray):
        cumulative = np.cumsum(irf, axis=-1, dtype=np.float64)
        cumulative /= cumulative[..., -1:]
        self._quantiles = None
        if irf.ndim == 1:       # a table is several times faster than a search, and exact to 2⁻¹⁶ of the photons
            edges = np.concatenate([[0.0], cumulative])
            quantile = np.interp(np.linspace(0, 1, QUANTILES + 1), edges, np.arange(len(edges)))
            self._quantiles, self._steps = quantile[:-1].astype(np.float32), np.diff(quantile).astype(np.float32)
        else:
            self._cumulative = cumulative + np.arange(len(irf))[:, None]        # of pixel p in (p, p + 1]

    def __call__(self, pixel: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """One draw for every entry of `pixel`, float32."""
        if self._quantiles is not None:
            drawn = random.integers(0, QUANTILES, len(pixel), dtype=np.uint16)
            return self._quantiles[drawn] + self._steps[drawn] * random.random(len(pixel), dtype=np.float32)
        found = np.searchsorted(self._cumulative.ravel(), pixel + random.random(len(pixel)), side="right")
        length = self._cumulative.shape[1]
        return (found - pixel.astype(np.int64) * length + random.random(len(pixel))).astype(np.float32)
