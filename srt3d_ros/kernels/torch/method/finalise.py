"""The end of a frame: keep points with enough evidence, and estimate intensity, error and background."""

import torch

from srt3d_ros.kernels.constants import EPSILON, LOCAL_SIGMA, TINY
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, RESIDUAL, SCORE, STD, VALUE
from srt3d_ros.kernels.torch.arithmetic import noise_ratio
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.windows import blur, inner


@fused
def drop_weak(state, enough) -> None:
    """Remove points with a score below `enough`, in place: r = 0."""
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= enough


@fused
def finalise(frame, photons, state, terms, enough):
    """Points with score / c(t) > `enough`: r + (own − r) (1 − v / s²)₊, √(std² + residual²); and the background.

    own = R(z, t) / (g E) is the intensity from the point's own pixel alone, r from its pool. v = (g r I₁ + (n − g r)₊
    I₀) / (E g)² is the variance of own by photon noise, s² the mean square of own − r, both averaged with a
    Gaussian of σ = LOCAL_SIGMA pixels: s² − v is how far the pixels themselves differ (James and Stein's estimator).
    Intensities are kept above 0.
    """
    view, value = inner(frame, state), inner(frame, terms)[:, :, VALUE]
    counts, exposure = (inner(frame, values)[:, None] for values in (frame.counts, frame.exposure))
    pooled, light = view[:, :, INTENSITY], exposure.clamp(min=EPSILON)
    signal, gain, there = pooled * light, frame.total_energy * light, pooled > 0
    excess, (of_signal, of_background) = value / gain - pooled, frame.intensity_moments
    variance = signal * of_signal + (counts - signal).clamp(min=0) * of_background
    around, noise = (blur(values * there, LOCAL_SIGMA) for values in (excess * excess, variance / gain**2))
    differ = 1 - (noise / around.clamp(min=TINY)).clamp(max=1)
    score = view[:, :, SCORE] / noise_ratio(frame, view[:, :, DEPTH])
    intensity = torch.maximum(pooled + excess * differ, EPSILON * pooled) * (there & (score > enough))
    points = state.clone()
    inner(frame, points)[:, :, INTENSITY] = intensity
    inner(frame, points)[:, :, STD] = (view[:, :, STD]**2 + view[:, :, RESIDUAL]**2).sqrt().clamp(
        EPSILON, frame.num_bins)
    left = photons - (intensity * exposure).sum(dim=1)
    return points, left.clamp(min=0), background(left, exposure[:, 0])


def background(left, exposure):
    """Background photons from the photons that the points leave, `left`, and g; float32 [rows, cols] each.

    g times the local mean of `left` over that of g, at least 0; `left` itself in masked pixels. Clipping single pixels
    instead would turn their noise into several times as much background where there is less than a photon.
    """
    used = exposure > 0
    rate = _blurred(left * used) / _blurred(exposure + EPSILON)
    return (rate * exposure + left * ~used).clamp(min=0)


@fused
def local_mean(values, used):
    """Local means of values over the used pixels, with the window of `finalise`; 0 in others; float32 [rows, cols]."""
    return _blurred(values * used) / _blurred(used + EPSILON) * used


def _blurred(image):
    return blur(image[:, None], LOCAL_SIGMA)[:, 0]
