"""Photons that look wrong: hot pixels, a leak that piles up in one bin, times in another unit. A text, or nothing."""

from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms

REACH = 2                   # pixels around, 24 neighbours
AROUND = np.arange((2 * REACH + 1)**2).reshape(2 * REACH + 1, -1) != 2 * REACH * (REACH + 1)
BRIGHTEST_LEFT_OUT = 3      # of the neighbours: other hot pixels. A line one pixel wide has 4
HOT = 4                     # times the photons of the next neighbour and 2 more: no chance of any mean reaches it
LEAK_SHARE, LEAK_RATIO = 0.05, 10       # of an end bin, least: of all photons; times the bin beside it
ENOUGH = 50                 # photons, before anything is said
SMALL_PART = 1 / 8          # of T
WATCH_S = 1.0               # between looks at a stream
FLOOR_SHARE = 0.02          # of the IRF's photons: intensities then become so much too large
FLAT = 1.3                  # photons of the second eighth of an IRF with a floor over those of the first


class Light(NamedTuple):
    """Where the photons of a frame are."""

    of_bins: np.ndarray         # float64 [T], of all pixels
    dark: np.ndarray            # float64 [rows, cols], in the emptiest quarter of the bins, where signal is rare
    of_pixels: np.ndarray       # float64 [rows, cols]


def light_of(frame: PhotonFrame, sensor: SensorModel) -> Light:
    """The photons in bins and pixels."""
    frame = frame.to_events(sensor) if isinstance(frame, PhotonGates) else frame
    if isinstance(frame, PhotonHistograms):
        counts = frame.on_axis(sensor)
        of_bins = counts.sum(axis=(0, 1), dtype=np.float64)
        dark = counts[..., emptiest_quarter(of_bins)]
        return Light(of_bins, *(part.sum(axis=2, dtype=np.float64) for part in (dark, counts)))
    toa = sensor.toa_bins(frame.toa)
    of_bins = np.bincount(toa, minlength=sensor.num_bins).astype(np.float64)
    quarter = emptiest_quarter(of_bins)
    inside = frame.pixel[(toa >= quarter.start) & (toa < quarter.stop)]
    dark, of_pixels = (np.bincount(pixel, minlength=sensor.pixels).reshape(sensor.shape).astype(np.float64)
                       for pixel in (inside, frame.pixel))
    return Light(of_bins, dark, of_pixels)


def hot_pixels(light: Light, sensor: SensorModel) -> np.ndarray:
    """Used pixels far brighter than those around where signal is rare, and that have hardly any; bool [rows, cols]."""
    dark = light.dark * sensor.used
    hot = (dark > 2 * HOT) & (light.of_pixels < 8 * dark)       # background alone: 4 quarters
    if min(dark.shape) <= REACH or not hot.any():
        return np.zeros(dark.shape, bool)
    from scipy.ndimage import rank_filter  # here: slow

    return hot & (dark > HOT * (2 + rank_filter(dark, -1 - BRIGHTEST_LEFT_OUT, footprint=AROUND, mode="mirror")))


def leak(light: Light) -> str:
    """A warning of photons that pile up in the first or the last bin."""
    photons = light.of_bins.sum()
    for name, (end, beside) in (("first", light.of_bins[:2]), ("last", light.of_bins[:-3:-1])):
        if end >= max(LEAK_SHARE * photons, LEAK_RATIO * beside, ENOUGH):
            return (f"{end / photons:.0%} of the photons are in the {name} bin, and hardly any beside it: a leak or an "
                    "overflow, which hides dimmer surfaces; leave it out (gate)")
    return ""


def other_unit(events: PhotonEvents, sensor: SensorModel) -> str:
    """A warning of ToA with fractions that all lie in a small part of the bins."""
    toa = events.toa
    if toa.dtype.kind != "f" or len(toa) < ENOUGH or toa.max() >= SMALL_PART * sensor.num_bins:
        return ""
    return (f"all ToA have fractions and lie below {toa.max():.4g} of {sensor.num_bins} bins: if they are nanoseconds, "
            "divide them by the bin width in nanoseconds")


def floor_of(irf: np.ndarray) -> np.ndarray | None:
    """The darker end of an IRF, [L / 8] or [pixels, L / 8], if it is flat and bright: dark counts or ambient light."""
    mean = np.atleast_2d(irf).mean(axis=0)
    eighth = len(mean) // 8
    if eighth < 2:
        return None
    darker = min(irf, irf[..., ::-1], key=lambda one: one[..., :eighth].sum())
    floor, beside = np.atleast_2d(darker).mean(axis=0)[:2 * eighth].reshape(2, -1).mean(axis=1)
    is_floor = floor * len(mean) > FLOOR_SHARE * mean.sum() > 0 and beside < FLAT * floor < 0.5 * mean.max()
    return darker[..., :eighth] if is_floor else None


def emptiest_quarter(of_bins: np.ndarray) -> slice:
    """The quarter of the bins, one after the other, with the fewest photons."""
    width = max(len(of_bins) // 4, 1)
    first = int(window_sums(of_bins, width).argmin())
    return slice(first, first + width)


def window_sums(of_bins: np.ndarray, width: int) -> np.ndarray:
    """Photons in each window of `width` bins; [T − width + 1]."""
    below = np.concatenate([[0], np.cumsum(of_bins)])
    return below[width:] - below[:-width]


class LightWatch:
    """Looks at the photons of a stream: for hot pixels in the first second, then once a second for a leak and for times
    in another unit; at the IRF.

    Attributes:
        hot: bool [rows, cols], none before the first second has passed.
        warning: what looks wrong, or "".
    """

    def __init__(self, sensor: SensorModel):
        self.hot, self.warning = np.zeros(sensor.shape, bool), ""
        self._sensor, self._since_s, self._first_second = sensor, -np.inf, True
        self._light: Light | None = None
        self._floor = "" if floor_of(sensor.irf) is None else (
            "the sensor's irf has a floor (dark counts): intensities are too large until it is taken off")

    def look(self, frame: PhotonFrame, now_s: float) -> bool:
        """Look at a frame or packet of the sensor at this time; returns whether the first second has just passed."""
        if self._first_second:
            light = light_of(frame, self._sensor)
            self._since_s = now_s if self._light is None else self._since_s
            self._light = light if self._light is None else Light(*map(np.add, light, self._light))
        if 0 <= now_s - self._since_s < WATCH_S:
            return False
        self._since_s, light = now_s, self._light or light_of(frame, self._sensor)
        if light.of_bins.sum() < ENOUGH:
            return False
        unit = other_unit(frame, self._sensor) if isinstance(frame, PhotonEvents) else ""
        self.warning, first = unit or leak(light) or self._floor, self._first_second
        if first:
            self.hot, self._first_second, self._light = hot_pixels(light, self._sensor), False, None
        return first

    def masked(self, sensor: SensorModel) -> SensorModel:
        """The sensor without the hot pixels, if there are any; as it is if it has a mask."""
        return sensor.replace(mask=~self.hot) if sensor.mask is None and self.hot.any() else sensor
