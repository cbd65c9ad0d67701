"""Windows of maps: views whose extra axes are the places around a pixel, and sums over them.

Once compiled, nothing of [places × rows × cols] is stored: every sum reads its neighbours in place.
"""

import torch

from srt3d_ros.kernels.maps import LANES, MARGIN, crop
from srt3d_ros.kernels.torch.fusing import fused


def inner(frame, padded):
    """The view [rows, …, cols] of a padded map."""
    return crop(padded, *frame.shape)


def images(frame, padded):
    """The view […, rows, cols] of a padded map."""
    return inner(frame, padded).movedim(0, -2)


def pad(values):
    """`maps.pad` of [rows, …, cols]."""
    right = -values.shape[-1] % LANES + MARGIN
    return torch.nn.functional.pad(values, (MARGIN, right, *(0, 0) * (values.ndim - 2), MARGIN, MARGIN))


def pad_images(values):
    """`maps.pad` of […, rows, cols]."""
    return pad(values.movedim(-2, 0))


def offsets(radius: int, like, step: int = 1) -> tuple:
    """dy and dx of the places of a square window, row by row, multiples of `step`: [N, 1, 1] each."""
    side = torch.arange(-(radius // step) * step, radius + 1, step, device=like.device, dtype=like.dtype)
    return tuple(d.reshape(-1, 1, 1) for d in torch.meshgrid(side, side, indexing="ij"))


def neighbours(frame, padded, radius: int, step: int = 1):
    """The values [N, …, rows, cols] of a padded map at these places around each pixel."""
    (rows, cols), reach = frame.shape, radius // step * step
    places = slice(MARGIN - reach, MARGIN + reach + 1, step)
    shifted = padded.unfold(0, rows, 1)[places].unfold(-2, cols, 1)             # [dy, …, dx, rows, cols]
    return shifted.movedim(-3, 1)[:, places].flatten(0, 1)


def box(values, radius: int):
    """Sums over square windows of images [..., rows, cols], 0 outside."""
    side = 2 * radius + 1
    padded = torch.nn.functional.pad(values, (radius,) * 4)
    return padded.unfold(-2, side, 1).unfold(-2, side, 1).sum((-2, -1))


def gaussian(sigma: float, like):
    """`maps.window_weights`."""
    radius = -int(-2.5 * sigma // 1)
    return torch.exp(-torch.arange(-radius, radius + 1, device=like.device, dtype=like.dtype)**2 / (2 * sigma**2))


def window_sums(values, weights):
    """Σ_ab w_a w_b · values[i + a, c, j + b], 0 outside, of [..., rows, C, cols]; weights [taps], or [C, 1, taps]."""
    return across_sums(down_sums(values, weights), weights)


def down_sums(values, weights):
    """The sums over rows alone."""
    radius = weights.shape[-1] // 2
    tall = torch.nn.functional.pad(values, (0, 0, 0, 0, radius, radius))
    return (tall.unfold(-3, 2 * radius + 1, 1) * weights).sum(-1)


def across_sums(values, weights):
    """The sums over columns alone."""
    radius = weights.shape[-1] // 2
    wide = torch.nn.functional.pad(values, (radius, radius))
    return (wide.unfold(-1, 2 * radius + 1, 1) * weights).sum(-1)


@fused
def blur(values, sigma):
    """`window_sums` of [rows, C, cols] by a Gaussian, σ in pixels."""
    return window_sums(values, gaussian(sigma, values))


def cell_sums(values, step: int):
    """Sums over cells of `step` × `step` pixels, [⌈rows / step⌉, C, ⌈cols / step⌉]."""
    rows, _, cols = values.shape
    whole = torch.nn.functional.pad(values, (0, -cols % step, 0, 0, 0, -rows % step))
    return whole.unflatten(0, (-1, step)).unflatten(-1, (-1, step)).sum((1, -1))
