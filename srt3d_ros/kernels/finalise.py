"""The end of a frame: keep points with enough evidence, and estimate intensity, error and background.

Written once, for the arrays of all kernel backends.
"""

from srt3d_ros.kernels.constants import EPSILON, TINY, WINDOWS
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, RESIDUAL, SCORE, STD, VALUE, crop

LOCAL_SIGMA = WINDOWS[0][0]     # pixels, of the window over which pixels are compared


def finalise(kernels, frame, photons, state, terms, enough):
    """Points with score / c(t) > `enough`: r + (own − r) (1 − v / s²)₊, √(std² + residual²); and the background.

    own = R(z, t) / (g E) is the intensity from the point's own pixel alone, r from its pool. v = (g r I₁ + (n − g r)₊
    I₀) / (E g)² is the variance of own by photon noise, s² the mean square of own − r, both averaged with a
    Gaussian of σ = 2 pixels, the first of WINDOWS: s² − v is how far the pixels themselves differ (James and Stein's
    estimator). Intensities are kept above 0.

    `photons` are n, masked pixels included, float32 [rows, cols]. Returns intensity (0: no point) and standard
    deviation, bins, float32 [rows, K, cols], and (n − g Σ_k r_k)₊ and background photons, float32 [rows, cols].
    """
    view, terms = crop(state, *frame.shape), crop(terms, *frame.shape)
    counts, exposure = (crop(values, *frame.shape)[:, None] for values in (frame.counts, frame.exposure))
    pooled, light, there = view[:, :, INTENSITY], exposure.clip(min=EPSILON), view[:, :, INTENSITY] > 0
    signal, gain = pooled * light, frame.total_energy * light
    excess, (of_signal, of_background) = terms[:, :, VALUE] / gain - pooled, frame.intensity_moments
    variance = signal * of_signal + (counts - signal).clip(min=0) * of_background
    around, noise = (kernels.blur(values * there, LOCAL_SIGMA) for values in (excess * excess, variance / gain**2))
    differ = 1 - (noise / around.clip(min=TINY)).clip(max=1)
    score = view[:, :, SCORE] / kernels.noise_ratio(frame, view[:, :, DEPTH])
    intensity = (pooled + excess * differ).clip(min=EPSILON * pooled) * (there & (score > enough))
    std = ((view[:, :, STD]**2 + view[:, :, RESIDUAL]**2)**0.5).clip(EPSILON, frame.num_bins)
    left = photons[:, None] - (intensity * exposure).sum(axis=1)[:, None]
    return intensity, std, left[:, 0].clip(min=0), background(kernels, left, exposure)


def background(kernels, left, exposure):
    """Background photons, [rows, cols], from the photons that the points leave, `left`, [rows, 1, cols] as `exposure`.

    g times the local mean of `left` over that of g, at least 0. Clipping single pixels instead would turn their noise
    into several times as much background where there is less than a photon.
    """
    used = exposure > 0
    rate = kernels.blur(left * used, LOCAL_SIGMA) / kernels.blur(exposure + EPSILON, LOCAL_SIGMA)
    return (rate * exposure + left * ~used).clip(min=0)[:, 0]


def without_weak(kernels, state, enough) -> None:
    """Remove points with a score below `enough`, in place: r = 0."""
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= enough


def nearness(kernels, used):
    """1 / Σ w over the used pixels around each used one, for `averaged`; [rows, cols]."""
    return used / kernels.blur((used + EPSILON)[:, None], LOCAL_SIGMA)[:, 0]


def averaged(kernels, values, used, near):
    """Local means over the used pixels of an array [rows, cols], with the window of `finalise`; 0 in other pixels."""
    return kernels.blur((values * used)[:, None], LOCAL_SIGMA)[:, 0] * near


def unexplained(kernels, frame, state, intensity, rest, taken, used, near, passed):
    """The kernel `unexplained`, with averages over the window of `finalise`."""
    own, seen = rest * used, crop(frame.counts, *frame.shape)
    return kernels.unexplained(frame, state, intensity, own, own if taken is None else taken,
                               averaged(kernels, own, used, near), averaged(kernels, seen, used, near), passed)
