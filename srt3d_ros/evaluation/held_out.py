"""Measure how well a cloud predicts held-out photons (equations: docs/evaluation.md)."""

import numpy as np
from scipy.ndimage import uniform_filter

from srt3d_ros.core.expected_photons import expected_at
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
    used, seen_by = sensor.exposure.reshape(-1) > 0, sensor.exposure.reshape(-1).astype(np.float64)
    signal = np.bincount(cloud.pixel, np.maximum(cloud.intensity.astype(np.float64), 0), minlength=sensor.pixels)
    photons = used * np.bincount(seen.pixel, minlength=sensor.pixels)
    background, without = (_around(rest, sensor) for rest in (np.maximum(photons - seen_by * signal, 0), photons))
    pixel = held_out.pixel.astype(np.int64)
    expected, shape = expected_at(cloud, sensor, pixel, held_out.toa)
    shape = EVEN_BACKGROUND + (1 - EVEN_BACKGROUND) * shape
    log_ratio = np.log((expected * sensor.num_bins + background[pixel] * shape) / (without[pixel] * shape))
    more_expected = share / (1 - share) * seen_by * (signal + background - without)
    nats = np.bincount(pixel, log_ratio, minlength=sensor.pixels) - more_expected
    variance = np.bincount(pixel, log_ratio**2, minlength=sensor.pixels)
    per_pixel = 100 / np.count_nonzero(used)
    return {"held_out_nats": float(per_pixel * nats[used].sum()),
            "held_out_std": float(per_pixel * np.sqrt(variance[used].sum()))}


def _around(photons: np.ndarray, sensor: SensorModel) -> np.ndarray:
    """Photons over exposure in the window around each pixel, at least SMALLEST_BACKGROUND; float64 [pixels]."""
    photons, exposure = (
        uniform_filter(np.reshape(values, sensor.shape).astype(float), NEIGHBOURHOOD, mode="nearest")
        for values in (photons, sensor.exposure))
    return np.maximum(photons / np.maximum(exposure, 1e-9), SMALLEST_BACKGROUND).reshape(-1)
