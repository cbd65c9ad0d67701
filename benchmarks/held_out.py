"""Judge a reconstruction without a reference: how well it predicts photons that were kept from it."""

from dataclasses import replace

import numpy as np

SHARE = 0.6                 # of the photons that are reconstructed
SEED = 7
LEAST_BACKGROUND = 0.02     # photons of a pixel
WINDOW = 5                  # pixels along the side of the square over which the background is averaged


def split(photons):
    """The photons (PhotonEvents) to reconstruct and those that judge the cloud."""
    chosen = np.random.default_rng(SEED).random(len(photons.pixel)) < SHARE
    return tuple(replace(photons, pixel=photons.pixel[part], toa=photons.toa[part]) for part in (chosen, ~chosen))


def gain(cloud, sensor, seen, kept) -> float:
    """Poisson log-likelihood of the kept photons under the cloud, over that under "background only"; nats / 100 pixels.

    A pixel with points (t_k, r_k) expects λ(x) = (1 − s) / s · (Σ_k r_k h(x − t_k) + B / T) of them in bin x. s is
    SHARE, h the IRF, B what the cloud leaves of the seen photons, averaged over WINDOW × WINDOW pixels.

    Args:
        cloud: the reconstruction of `seen`.
        sensor: with one IRF for all pixels.
        seen, kept: of `split`.
    """
    bins, pixels, shape = sensor.num_bins, sensor.pixels, (sensor.rows, sensor.cols)
    pixel, intensity = cloud.row.astype(int) * sensor.cols + cloud.col, np.maximum(cloud.intensity.astype(float), 0)
    photons, signal = np.bincount(seen.pixel, minlength=pixels), np.bincount(pixel, intensity, minlength=pixels)
    explained = np.minimum(signal, photons.max() + 1)
    background = _background(np.maximum(photons - explained, 0).reshape(shape))
    without = _background(photons.reshape(shape))

    irf = np.zeros(bins)
    irf[:len(sensor.irf)] = sensor.irf / sensor.irf.sum(dtype=float)
    at = kept.pixel.astype(int)
    density = background[at] / bins
    for rank in np.unique(cloud.surface):
        points = cloud.surface == rank
        depth, strength = np.zeros(pixels), np.zeros(pixels)
        depth[pixel[points]], strength[pixel[points]] = cloud.depth_bins[points], intensity[points]
        low, between = np.divmod((sensor.toa_positions(kept.toa) - depth[at] + sensor.irf_ref) % bins, 1)
        low = low.astype(int)
        density += strength[at] * ((1 - between) * irf[low % bins] + between * irf[(low + 1) % bins])
    photon_terms = np.log(density * bins / without[at]).sum()
    expected = (1 - SHARE) / SHARE * (background + signal - without).sum()
    return float(100 * (photon_terms - expected) / pixels)


def _background(photons: np.ndarray) -> np.ndarray:
    """Mean photons of the pixels around each, at least LEAST_BACKGROUND; float [pixels]."""
    padded = np.pad(photons.astype(float), WINDOW // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (WINDOW, WINDOW))
    return np.maximum(windows.mean(axis=(2, 3)).ravel(), LEAST_BACKGROUND)
