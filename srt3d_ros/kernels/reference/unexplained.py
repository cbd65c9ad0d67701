"""What a reconstruction leaves of its frame: `unexplained` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.maps import DEPTH
from srt3d_ros.kernels.reference.arithmetic import EPSILON, TINY, angular


def unexplained(frame, state, intensity, own, taken, background, photons, passed):
    counts, light, depth = (maps.crop(values, *frame.shape).astype(float) for values in (
        frame.counts, frame.exposure, state[:, :, DEPTH]))
    m = len(frame.energy)
    matched = np.moveaxis(maps.crop(frame.matched, *frame.shape), 1, -1)
    phase = np.exp(1j * angular(frame) * depth[..., None])                          # [rows, K, cols, m]
    points = light[..., None] * (intensity[..., None] * phase).sum(axis=1)
    rest = matched[..., :m] + 1j * matched[..., m:] - frame.energy * points
    around = np.maximum(photons, EPSILON)
    share = background / around
    left, seen = ((share[..., None] * values).sum(axis=(0, 1)) for values in (np.conj(passed) * rest, points))
    misfit = (np.abs(rest)**2 / np.maximum(frame.energy, TINY) / around[..., None]).sum()
    return np.array([*left.real, *left.imag, *seen.real, *seen.imag, (share * own).sum(), (share * taken).sum(),
                     (share**2 * counts).sum(), misfit])
