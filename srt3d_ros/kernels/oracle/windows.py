"""Windows of padded maps: the neighbours are an axis. Blocks of rows bound the memory that this takes."""

from collections.abc import Callable
from dataclasses import is_dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import torch

from srt3d_ros.kernels.maps import MARGIN

MEMORY = 2**28          # bytes that a block of rows works in, if that is more than one


class Window(NamedTuple):
    """Places (dy, dx) around a pixel, row by row: as indices [N] of padded maps, and as numbers [N, 1, 1]."""

    row: torch.Tensor
    col: torch.Tensor
    dy: torch.Tensor
    dx: torch.Tensor


@lru_cache(maxsize=None)        # a graph that is being recorded cannot wait for a copy, and reads them while it lives
def window(radius: int, low: int, high: int, step: int, dtype, device) -> Window:
    """The places of a round window whose larger part is a multiple of `step` in (low, high]."""
    side = range(-(radius // step) * step, radius + 1, step)
    return _window([(dy, dx) for dy in side for dx in side
                    if low < max(abs(dy), abs(dx)) <= high and dy**2 + dx**2 <= radius * (radius + 1)], dtype, device)


@lru_cache(maxsize=None)
def square(radius: int, dtype, device) -> Window:
    """The places of a square window."""
    side = range(-radius, radius + 1)
    return _window([(dy, dx) for dy in side for dx in side], dtype, device)


def _window(places, dtype, device) -> Window:
    dy, dx = torch.tensor(places, device=device).unbind(1)
    return Window(dy + MARGIN, dx + MARGIN, *(d.to(dtype)[:, None, None] for d in (dy, dx)))


def inner(padded):
    """The view [rows, …, cols] of a padded map; as many columns as whole blocks have."""
    return padded[MARGIN:-MARGIN, ..., MARGIN:-MARGIN]


def images(values):
    """The view […, rows, cols] of values [rows, …, cols]."""
    return values.movedim(0, -2)


def neighbours(padded, window: Window):
    """The values [N, …, rows, cols] of a padded map at the places around each pixel."""
    rows, cols = padded.shape[0] - 2 * MARGIN, padded.shape[-1] - 2 * MARGIN
    shifted = padded.unfold(0, rows, 1).unfold(-2, cols, 1)             # by [row, …, col, :, :]
    return shifted[window.row, ..., window.col, :, :]


def by_rows(function: Callable, row_bytes: int, *maps, margin: int = MARGIN) -> tuple:
    """The results, tensors [rows, …] in a tuple, of a function of maps; it works on so many rows at once as MEMORY has.

    Args:
        function: of as many maps, each the rows in question with `margin` above and below.
        row_bytes: that it works in for each row.
        maps: tensors [rows + 2 · margin, …], or frames of such.
    """
    sizes = [len(values) for values in maps if isinstance(values, torch.Tensor)]
    rows, height = sizes[0] - 2 * margin, max(MEMORY // row_bytes, 1)
    parts = [function(*(_cut(values, first, min(first + height, rows) + 2 * margin) for values in maps))
             for first in range(0, rows, height)]
    return parts[0] if len(parts) == 1 else tuple(map(torch.cat, zip(*parts)))


def _cut(values, first: int, end: int):
    """Some rows of a map, or of the maps of a frame."""
    if is_dataclass(values):
        return replace(values, **{name: getattr(values, name)[first:end] for name in ("matched", "counts", "exposure")})
    return values[first:end]
