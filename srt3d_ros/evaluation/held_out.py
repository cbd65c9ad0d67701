"""How well a cloud predicts photons that were kept from its reconstruction; docs/evaluation.md has the equations."""

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel

SEED = 7
USUAL_SHARE = 0.4           # of the photons of a file without a reference: docs/evaluation.md
LEAST_PHOTONS = 100         # of each part of a file
LEAST_BACKGROUND = 0.02     # photons of a pixel of gain 1
EVEN_BACKGROUND = 0.01      # share of a known background that is spread evenly, for bins where it has none
WINDOW = 5                  # pixels along the side of the square over which the background is averaged
SURFACE_WIDTHS = 3          # full widths of the IRF at half its peak: neighbours on one surface lie so near in depth
RIM_NEIGHBOURS = 2          # of the 8, not on its surface: enough to make a point one of the rim


def split(frame: PhotonEvents, share: float) -> tuple[PhotonEvents, PhotonEvents]:
    """The photons to reconstruct, and those held out: each with the probability `share`, the same ones every time."""
    seen = np.random.default_rng(SEED).random(frame.photons) < 1 - share
    return frame.part(seen), frame.part(~seen)


def gain(cloud: PointCloud, sensor: SensorModel, seen: PhotonEvents, held_out: PhotonEvents, share: float) -> dict:
    """Log-likelihood of the held-out photons under the cloud, over that under "background only"; nats / 100 pixels.

    Args:
        cloud: reconstructed from the photons `seen`.
        share: of all photons that is held out.

    Returns:
        held_out_nats and held_out_std, its standard error, over all pixels that are not masked; what the rim and the
        interior (`zones`) add to it, held_out_rim_nats, …_std, and how many of the pixels these are, …_percent.
    """
    seen_by = sensor.exposure.reshape(-1).astype(np.float64)
    signal, background, without = _rates(cloud, sensor, seen, seen_by)
    pixel = held_out.pixel.astype(np.int64)
    log_ratio = _log_ratio(cloud, sensor, pixel, held_out.toa, background, without)
    more_expected = share / (1 - share) * seen_by * (signal + background - without)
    nats = np.bincount(pixel, log_ratio, minlength=sensor.pixels) - more_expected
    variance = np.bincount(pixel, log_ratio**2, minlength=sensor.pixels)

    used = seen_by > 0
    rim, interior = (zone.reshape(-1) & used for zone in zones(cloud, sensor))
    pixels = np.count_nonzero(used)
    found = {"held_out_rim_percent": float(100 * rim.sum() / pixels),
             "held_out_interior_percent": float(100 * interior.sum() / pixels)}
    for name, zone in (("held_out", used), ("held_out_rim", rim), ("held_out_interior", interior)):
        found |= {f"{name}_nats": float(100 * nats[zone].sum() / pixels),
                  f"{name}_std": float(100 * np.sqrt(variance[zone].sum()) / pixels)}
    return found


def zones(cloud: PointCloud, sensor: SensorModel) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the rim and of the interior of the surfaces, bool [rows, cols] each.

    A point belongs to the rim if RIM_NEIGHBOURS of the 8 pixels around, masked ones and those outside of the image not
    counted, have no point within SURFACE_WIDTHS widths of the IRF. The rim is the pixels of these points and the
    pixels without points beside them, the interior all others with points.
    """
    rows, cols = sensor.rows, sensor.cols
    irf = np.atleast_2d(sensor.irf).mean(axis=0)
    near = SURFACE_WIDTHS * np.count_nonzero(irf >= irf.max() / 2)
    layers = np.full((int(cloud.surface.max(initial=0)) + 1, rows, cols), np.nan)
    layers[cloud.surface, cloud.row, cloud.col] = cloud.depth_bins
    around = np.pad(layers, ((0, 0), (1, 1), (1, 1)), mode="edge")
    used = np.pad(sensor.exposure > 0, 1, mode="edge")
    apart = np.zeros(layers.shape, np.uint8)
    for y, x in np.ndindex(3, 3):
        there = (slice(y, y + rows), slice(x, x + cols))
        steps = circular_difference(around[:, None, *there], layers, sensor.num_bins)
        apart += ~(np.abs(steps) <= near).any(axis=0) & used[there]
    occupied = np.isfinite(layers)
    rim = (occupied & (apart >= RIM_NEIGHBOURS)).any(axis=0)
    occupied = occupied.any(axis=0)
    rim |= _windows(rim, 3).any(axis=(2, 3)) & ~occupied
    return rim, occupied & ~rim


def _rates(cloud: PointCloud, sensor: SensorModel, seen: PhotonEvents, seen_by: np.ndarray):
    """Signal, background, and background if there is no signal; photons of a pixel at gain 1, float [pixels] each."""
    intensity = np.maximum(cloud.intensity.astype(np.float64), 0)
    signal = np.bincount(_pixel(cloud, sensor), intensity, minlength=sensor.pixels)
    photons = np.bincount(seen.pixel, minlength=sensor.pixels) * (seen_by > 0)
    exposed = _around(seen_by, sensor)
    return signal, *(np.maximum(_around(part, sensor) / np.maximum(exposed, 1e-9), LEAST_BACKGROUND)
                     for part in (np.maximum(photons - seen_by * signal, 0), photons))


def _log_ratio(cloud: PointCloud, sensor: SensorModel, pixel: np.ndarray, toa: np.ndarray, background: np.ndarray,
               without: np.ndarray) -> np.ndarray:
    """log(λ / λ₀) of each photon."""
    bins, of_point = sensor.num_bins, _pixel(cloud, sensor)
    position = sensor.toa_positions(toa).astype(np.float64)
    if sensor.delay_bins is not None:
        position -= sensor.delay_bins.reshape(-1)[pixel]
    signal = np.zeros(len(pixel))
    for rank in np.unique(cloud.surface):
        points = cloud.surface == rank
        depth, intensity = np.zeros((2, sensor.pixels))
        depth[of_point[points]] = cloud.depth_bins[points]
        intensity[of_point[points]] = np.maximum(cloud.intensity[points], 0)
        signal += intensity[pixel] * _irf_at(sensor, pixel, position - depth[pixel] + sensor.irf_ref)
    shape = np.ones(len(pixel))
    if sensor.background_shape is not None:
        shape = sensor.background_shape[sensor.toa_bins(position % bins)] * bins
        shape = EVEN_BACKGROUND + (1 - EVEN_BACKGROUND) * shape
    return np.log((signal * bins + background[pixel] * shape) / (without[pixel] * shape))


def _irf_at(sensor: SensorModel, pixel: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The IRF between its entries, modulo T, of the pixel of each photon."""
    irf = np.atleast_2d(sensor.irf)
    low, between = np.divmod(place, 1)

    def entry(index: np.ndarray) -> np.ndarray:
        index = index.astype(np.int64) % sensor.num_bins
        inside = index < irf.shape[1]
        return irf[pixel if len(irf) > 1 else 0, np.where(inside, index, 0)] * inside

    return (1 - between) * entry(low) + between * entry(low + 1)


def _pixel(cloud: PointCloud, sensor: SensorModel) -> np.ndarray:
    return cloud.row.astype(np.int64) * sensor.cols + cloud.col


def _around(values: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """The sum over the window around each pixel; float [pixels]."""
    return _windows(values.reshape(sensor.rows, sensor.cols), WINDOW).sum(axis=(2, 3)).reshape(-1)


def _windows(values: np.ndarray, size: int) -> np.ndarray:
    """The square of pixels around each, [rows, cols, size, size]; those of the border are repeated outside."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, size // 2, mode="edge"), (size, size))
