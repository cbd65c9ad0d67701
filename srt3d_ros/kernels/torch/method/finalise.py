"""The end of a frame: decide on points, estimate intensity, error and background."""

import torch

from srt3d_ros.kernels.constants import EPSILON, LOCAL_SIGMA, RELIEF_SCORE, SAME_SURFACE, TINY, WIDE_SCALE
from srt3d_ros.kernels.maps import (
    DEPTH,
    GRADIENT,
    INTENSITY,
    RESIDUAL,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    STD,
    VALUE,
)
from srt3d_ros.kernels.torch.arithmetic import noise_ratio, wrap
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.windows import blur, images, inner, neighbours, offsets


@fused
def drop_weak(state, enough) -> None:
    """Remove points with a score below `enough`, in place: r = 0."""
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= enough


@fused
def finalise(frame, photons, state, terms, enough):
    """Points with score / c(t) > `enough`: r + (own − r) (1 − v / s²)₊, √(std² + max(residual², relief)); background.

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
    hidden = relief(frame, counts, intensity * exposure, state, inner(frame, terms)[:, :, GRADIENT])
    inner(frame, points)[:, :, STD] = (view[:, :, STD]**2 + torch.maximum(view[:, :, RESIDUAL]**2, hidden)
                                       ).sqrt().clamp(EPSILON, frame.num_bins)
    left = photons - (intensity * exposure).sum(dim=1)
    return points, left.clamp(min=0), background(left, exposure[:, 0])


def relief(frame, counts, signal, state, gradient):
    """Mean square of the relief that pools average out, bins², from what the pixels' own photons say; `signal` is g r.

    A pixel's own photons lie gradient / (C g r) bins off its point and, less `off_neighbours`, off the points beside
    it, which do not follow these photons. Photon noise is v = V / (C g r)² of that square, V = g r M₁ + (n − g r) M₀;
    pools share at least std². So d = (gradient / C − g r off)² − (V / C² − (g r std)²)₊ has a mean of (g r τ)² where
    pixels differ by τ. τ² is Σ d / Σ (g r)² of the window σ = WIDE_SCALE with weights w if
    Σ w d > RELIEF_SCORE √(Σ w² d²), for Σ w² d² = Σ w d² / 2. All points where that fails share
    (D − Σ d² / D)₊ / Σ (g r)², D = Σ d (as James and Stein's estimator). A point that follows its own photons is no
    farther off than they are: the relief is v at most, here with V ≥ g r M₁. Uncalibrated delays of pixels look the
    same, and so does an IRF that is too narrow.
    """
    std, there, light2 = inner(frame, state)[:, :, STD], signal > 0, (signal * frame.curvature)**2
    noise = signal * frame.moments[0] + (counts - signal) * frame.moments[1]
    alone = torch.maximum(noise, signal * frame.moments[0]) / light2.clamp(min=TINY)
    off = off_neighbours(frame, state, (SAME_SURFACE**2 * alone).clamp(max=frame.resolution_bins**2))
    own = gradient / frame.curvature - signal * off
    differs = (own**2 - (noise / frame.curvature**2 - (signal * std)**2).clamp(min=0)) * there
    each = differs, signal**2, differs**2
    around, gives, squares = (blur(values, WIDE_SCALE) for values in each)
    shown = around > RELIEF_SCORE * (squares / 2).sqrt()
    rest, rest_gives, rest_squares = ((values * ~shown).sum() for values in each)
    whole = (rest - rest_squares / rest.clamp(min=TINY)).clamp(min=0) / rest_gives.clamp(min=TINY)
    tau2 = (around / gives.clamp(min=TINY)).where(shown, whole)
    return torch.minimum(tau2, alone)


def off_neighbours(frame, state, most):
    """Mean distance of the points beside, above and below from each point's plane, bins, of squares below `most`."""
    own, (dy, dx) = images(frame, state), (d[:, None] for d in offsets(1, state))
    depth, intensity = (neighbours(frame, state[:, :, field], 1) for field in (DEPTH, INTENSITY))
    e = wrap(depth - (own[:, DEPTH] + own[:, SLOPE_COL] * dx + own[:, SLOPE_ROW] * dy), frame.num_bins)
    near = (intensity > 0) & (e**2 < most.movedim(0, -2)) & (dy.abs() + dx.abs() == 1)
    return ((e * near).sum(0) / near.sum(0).clamp(min=1)).movedim(-2, 0)


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
