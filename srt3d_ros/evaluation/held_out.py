"""Measure how well a cloud predicts held-out photons (equations: docs/evaluation.md)."""

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents

SEED = 7
USUAL_SHARE = 0.4           # of the photons of a file without a reference (docs/evaluation.md)
LEAST_HELD_OUT = 100         # in each part of a file
SMALLEST_BACKGROUND = 0.02     # photons of a pixel with gain 1
EVEN_BACKGROUND = 0.01      # share of a known background that is spread evenly, because its shape may be 0 in bins
NEIGHBOURHOOD = 5                  # side of the square over which the background is averaged, pixels


def split(frame: PhotonEvents, share: float) -> tuple[PhotonEvents, PhotonEvents]:
    """Photons to reconstruct, and photons held out: each with probability `share`, the same ones every time."""
    seen = np.random.default_rng(SEED).random(frame.photons) < 1 - share
    return frame.part(seen), frame.part(~seen)


def gain(cloud: PointCloud, sensor: SensorModel, seen: PhotonEvents, held_out: PhotonEvents, share: float) -> dict:
    """Log-likelihood ratio of the held-out photons: cloud over "background only", nats / 100 pixels.

    Args:
        cloud: reconstructed from the photons `seen`.
        share: share of held-out photons.

    Returns:
        held_out_nats and its standard error held_out_std, over the pixels that are not masked.
    """
    seen_by = sensor.exposure.reshape(-1).astype(np.float64)
    signal, background, without = _rates(cloud, sensor, seen, seen_by)
    pixel = held_out.pixel.astype(np.int64)
    log_ratio = _log_ratio(cloud, sensor, pixel, held_out.toa, background, without)
    more_expected = share / (1 - share) * seen_by * (signal + background - without)
    nats = np.bincount(pixel, log_ratio, minlength=sensor.pixels) - more_expected
    variance = np.bincount(pixel, log_ratio**2, minlength=sensor.pixels)

    used = seen_by > 0
    pixels = np.count_nonzero(used)
    return {"held_out_nats": float(100 * nats[used].sum() / pixels),
            "held_out_std": float(100 * np.sqrt(variance[used].sum()) / pixels)}


def _rates(cloud: PointCloud, sensor: SensorModel, seen: PhotonEvents, seen_by: np.ndarray):
    """Signal, background, and background without signal; photons of a pixel at gain 1, float [pixels] each."""
    intensity = np.maximum(cloud.intensity.astype(np.float64), 0)
    signal = np.bincount(_pixel(cloud, sensor), intensity, minlength=sensor.pixels)
    photons = np.bincount(seen.pixel, minlength=sensor.pixels) * (seen_by > 0)
    exposed = np.maximum(_around(seen_by, sensor), 1e-9)

    def background(part: np.ndarray) -> np.ndarray:
        return np.maximum(_around(part, sensor) / exposed, SMALLEST_BACKGROUND)

    return signal, background(np.maximum(photons - seen_by * signal, 0)), background(photons)


def _log_ratio(cloud: PointCloud, sensor: SensorModel, pixel: np.ndarray, toa: np.ndarray, background: np.ndarray,
               without: np.ndarray) -> np.ndarray:
    """log(λ / λ₀) of each photon: rate with the cloud over rate without."""
    bins, of_point = sensor.num_bins, _pixel(cloud, sensor)
    position = toa - sensor.late.reshape(-1)[pixel].astype(np.float64)
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
    """The pixel's IRF at `place`, interpolated between entries, modulo T."""
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
    """Sum over the window around each pixel, with the border repeated outside; float [pixels]."""
    padded = np.pad(values.reshape(sensor.rows, sensor.cols), NEIGHBOURHOOD // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (NEIGHBOURHOOD, NEIGHBOURHOOD)).sum(axis=(2, 3)).reshape(-1)
