"""The end of a frame: final intensity and standard deviation of each point, and the background.

With own = R(z, t) / (g E), its variance by photon noise v and the local mean square s² of own − r, a point gets
r + (own − r) (1 − v / s²)₊ and √(std² + max(residual², min(τ², V / (g r C)²))) if score / c(t) is enough. With
d = (gradient / C − g r off)² − (V / C² − (g r std)²)₊, where the points beside it are `off` its plane, τ² is
D / Σ (g r)² of the window of WIDE_SCALE if D = Σ d is significant there, else (D − Σ d² / D)₊ / Σ (g r)² of all other
points. The photons that the points leave are n − g Σ_k r_k; g times their local mean over that of g is the background.
`kernels.torch` says why.
"""

from numba import float32

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import EPSILON, LOCAL_SIGMA, RELIEF_SCORE, SAME_SURFACE, TINY, WIDE_SCALE
from srt3d_ros.kernels.cpu.arithmetic import F32, wrap
from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats2d, floats3d, floats4d, inline
from srt3d_ros.kernels.cpu.method.frame import Frame, point_at
from srt3d_ros.kernels.cpu.method.likelihood import noise_at
from srt3d_ros.kernels.cpu.method.windows import across, sum_down
from srt3d_ros.kernels.cpu.spans import ALL, columns
from srt3d_ros.kernels.cpu.vectors import full, sqrt, where
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, LANES, MARGIN, SCORE, STD, VALUE

SHOWN = RELIEF_SCORE / 2**0.5       # RELIEF_SCORE of windows: Σ w² is half Σ w of a Gaussian


def drop_weak(state, enough):
    state[:, :, INTENSITY][state[:, :, SCORE] < enough] = 0


@inline
def _excess(i, k, j, frame, intensity, terms):
    """own − r, and E g."""
    gain = frame.total_energy * max(frame.exposure[i, j], EPSILON)
    return terms[i, k, VALUE, j] / gain - intensity, gain


@each
def _compare(i, j, frame: Frame, terms: floats4d, values: floats3d, state: floats4d):
    """Write (own − r)² and v of each surface, of which s² and the mean of v are made; 0 without a surface."""
    of_signal, of_background = frame.intensity_moments[0], frame.intensity_moments[1]
    for k in range(state.shape[1]):
        intensity = state[i, k, INTENSITY, j]
        excess, gain = _excess(i, k, j, frame, intensity, terms)
        signal, there = intensity * max(frame.exposure[i, j], EPSILON), intensity > 0
        variance = signal * of_signal + max(frame.counts[i, j] - signal, 0) * of_background
        values[i, 2 * k, j] = where(there, excess * excess, 0)
        values[i, 2 * k + 1, j] = where(there, variance / (gain * gain), 0)


@inline
def _off(state, i, k, j, point, most, frame):
    """Mean distance of the points beside, above and below from a point's plane, bins, of squares below `most`."""
    total, number = full(0.0), full(0.0)
    for dy, dx in ((-1, 0), (0, -1), (0, 1), (1, 0)):
        plane = point.depth + dx * point.slope_col + dy * point.slope_row
        e = wrap(state[i + dy, k, DEPTH, j + dx] - plane, frame.period)
        near = (state[i + dy, k, INTENSITY, j + dx] > 0) & (e * e < most)
        total, number = total + where(near, e, 0), number + where(near, 1, 0)
    return total / max(number, 1)


@inline
def _noise(signal, counts, frame):
    """V / C², the variance of gradient / C by photon noise."""
    variance = signal * frame.moments[0] + (counts - signal) * frame.moments[1]
    return variance / (frame.curvature * frame.curvature)


@inline
def _alone(signal, counts, frame):
    """V / (g r C)², the variance of a depth by a pixel's own photons, those of the surface at least."""
    return _noise(signal, max(counts, signal), frame) / max(signal * signal, TINY)


@each
def _decide(i, j, frame: Frame, terms: floats4d, enough: float32, window: floats1d, summed: floats3d,
            relief: floats3d, left: floats3d, points: floats4d, rest: floats2d, state: floats4d):
    """Write the points but for their std, d, (g r)², d², and the photons left; `rest` has all photons before."""
    light, counts, unexplained = frame.exposure[i, j], frame.counts[i, j], rest[i, j]
    for k in range(state.shape[1]):
        point = point_at(state, i, k, j)
        pooled, (excess, _) = point.intensity, _excess(i, k, j, frame, point.intensity, terms)
        around, noise = across(summed, i, 2 * k, j, window), across(summed, i, 2 * k + 1, j, window)
        differ = 1 - min(noise / max(around, TINY), 1)
        stays = (pooled > 0) & (point.score / noise_at(frame, point.depth) > enough)
        intensity = where(stays, max(pooled + excess * differ, EPSILON * pooled), 0)
        signal, shared = intensity * light, intensity * light * point.std
        most = min(SAME_SURFACE**2 * _alone(signal, counts, frame), frame.resolution * frame.resolution)
        own = terms[i, k, GRADIENT, j] / frame.curvature - signal * _off(state, i, k, j, point, most, frame)
        noise = max(_noise(signal, counts, frame) - shared * shared, 0)
        differs = where(stays, own * own - noise, 0)
        unexplained -= signal
        points[i, k, DEPTH, j], points[i, k, INTENSITY, j] = point.depth, intensity
        for part, value in enumerate((differs, signal * signal, differs * differs)):
            relief[i, 3 * k + part, j] = value
    rest[i, j] = max(unexplained, 0)
    left[i, 0, j], left[i, 1, j] = where(light > 0, unexplained, 0), light + EPSILON


@each
def _find_relief(i, relief: floats3d, wide: floats1d, summed: floats3d, tau2: floats3d, sums: floats3d):
    """Write τ² of the windows around points, and sums over the others of a row, of LANES columns each."""
    differs, gives, squares = full(0.0), full(0.0), full(0.0)
    for k in range(tau2.shape[1]):
        for j in columns(relief):
            around = across(summed, i, 3 * k, j, wide)
            shown = around > SHOWN * sqrt(across(summed, i, 3 * k + 2, j, wide))
            tau2[i, k, j] = where(shown, around / max(across(summed, i, 3 * k + 1, j, wide), TINY), 0)
            differs += where(shown, 0, relief[i, 3 * k, j])
            gives += where(shown, 0, relief[i, 3 * k + 1, j])
            squares += where(shown, 0, relief[i, 3 * k + 2, j])
    sums[i, 0, ALL], sums[i, 1, ALL], sums[i, 2, ALL] = differs, gives, squares


@each
def _widen(i, j, frame: Frame, state: floats4d, tau2: floats3d, whole: float32, points: floats4d):
    """Write √(std² + max(residual², min(τ², V / (g r C)²))); `whole` is τ² of all points whose windows show none."""
    for k in range(state.shape[1]):
        point, around = point_at(state, i, k, j), tau2[i, k, j]
        signal = points[i, k, INTENSITY, j] * frame.exposure[i, j]
        relief = min(where(around > 0, around, whole), _alone(signal, frame.counts[i, j], frame))
        std = sqrt(point.std * point.std + max(point.residual * point.residual, relief))
        points[i, k, STD, j] = min(max(std, EPSILON), frame.period)


@each
def _spread(i, j, exposure: floats2d, window: floats1d, summed: floats3d, rest: floats2d, out: floats2d):
    """Write g times the mean of the photons left over that of g; `rest` in masked pixels."""
    light = exposure[i, j]
    rate = max(across(summed, i, 0, j, window) / across(summed, i, 1, j, window), 0)
    out[i, j] = where(light > 0, rate * light, rest[i, j])


def finalise(work, frame, photons, state, terms, enough):
    window, wide = map(maps.window_weights, (LOCAL_SIGMA, WIDE_SCALE))
    points, rest, left = work.other_state(state), work.map("rest"), work.map("left", 2)
    relief, tau2, sums = work.map("relief", 3 * work.surfaces), work.map("τ²", work.surfaces), work.array(
        "sums", work.height, 3, LANES)
    maps.crop(rest, *work.shape)[:] = photons
    compared = work.map("compared", 2 * work.surfaces)
    _compare(frame, terms, compared, state)
    _decide(frame, terms, F32(enough), window, sum_down(work, compared, window), relief, left, points, rest, state)
    _find_relief(relief, wide, sum_down(work, relief, wide), tau2, sums)
    differs, gives, squares = sums[MARGIN:-MARGIN].swapaxes(0, 1).reshape(3, -1).cumsum(axis=1)[:, -1]
    whole = max(differs - squares / max(differs, TINY), 0) / max(gives, TINY)
    _widen(frame, state, tau2, F32(whole), points)
    return points, maps.crop(rest, *work.shape).copy(), _background(work, frame.exposure, left, rest)


def _background(work, exposure, left, rest):
    window, out = maps.window_weights(LOCAL_SIGMA), work.map("background")
    _spread(exposure, window, sum_down(work, left, window), rest, out)
    return maps.crop(out, *work.shape).copy()


def background(work, left, exposure):
    light, rest, seen = work.map("light"), work.map("unaveraged"), work.map("seen", 2)
    for padded, values in ((light, exposure), (rest, left.clip(min=0)), (seen[:, 0], left * (exposure > 0)),
                           (seen[:, 1], exposure + EPSILON)):
        maps.crop(padded, *work.shape)[:] = values
    return _background(work, light, seen, rest)


def local_mean(work, values, used):
    return background(work, values * used, used)
