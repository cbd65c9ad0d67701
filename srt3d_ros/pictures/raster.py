"""Draw points as an image: perspective, nearest on top, sized by distance, edges darkened. NumPy only.

A surface is drawn as discs in the order far to near, so that what is written last is what is seen. Edges are then
darkened from the depth of each picture element (eye-dome lighting: Boucheny, Interactive Scientific Visualization of
Large Datasets: Towards a Perceptive-Based Approach, thesis, Grenoble 2009), which shows shape without normals.
"""

import numpy as np

from srt3d_ros.viewpoint import Viewpoint

_NEAREST = 1e-3                             # of the distance to the target: what is nearer is behind the eye, or in it
_SMALLEST_RADIUS_PX, _LARGEST_RADIUS_PX = 0.75, 24.0
_EDGE_REACHES = (0.004, 0.015)              # of the picture's height: how far the darkening looks around
_EDGE_SLOPE = 0.7                           # depth over reach at which an edge is two thirds as dark as it gets
_DEEPEST_EDGE = 0.02                        # of the distance between eye and target: deeper ones are no darker
_DARKEST_EDGE = 0.5


def project(xyz: np.ndarray, eye: Viewpoint, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where points appear: x and y in pixels, and distance along the line of sight in metres (NaN: not in view).

    Args:
        xyz: float [N, 3], metres.
        eye: its fov_deg spans the picture's smaller side.
        width, height: of the picture, pixels.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        right, down, forward = ((np.asarray(xyz, np.float32) - eye.position.astype(np.float32))
                                @ eye.axes().T.astype(np.float32)).T
        nearest = _NEAREST * np.linalg.norm(eye.target - eye.position)
        forward = np.where(forward > nearest, forward, np.nan)
        focal = focal_px(eye, width, height)
        return right / forward * focal + width / 2, down / forward * focal + height / 2, forward


def focal_px(eye: Viewpoint, width: int, height: int) -> float:
    """Focal length of a picture, in pixels."""
    return min(width, height) / 2 / np.tan(np.radians(eye.fov_deg) / 2)


def draw_surface(xyz: np.ndarray, colour: np.ndarray, eye: Viewpoint, width: int, height: int, radius_m: float,
                 background: tuple[int, int, int] = (0, 0, 0), finer: int = 1) -> np.ndarray:
    """Points as discs that hide what is behind them; uint8 [height, width, 3].

    Args:
        xyz: float [N, 3], metres; points that are not finite are left out.
        colour: uint8 [N, 3].
        eye: where from.
        width, height: of the picture.
        radius_m: of the discs; they are at least one picture element.
        background: colour of what no disc covers.
        finer: drawn this many times larger, then averaged: 2 gives smooth edges for four times the work.
    """
    width, height = width * finer, height * finer
    x, y, depth = project(xyz, eye, width, height)
    seen = np.flatnonzero(np.isfinite(x + y + depth) & (np.abs(x) < 2 * width) & (np.abs(y) < 2 * height))
    seen = seen[np.argsort(-depth[seen])]
    x, y, depth = x[seen], y[seen], depth[seen]
    radius_px = radius_m * focal_px(eye, width, height) / depth
    radius_px = np.clip(radius_px, _SMALLEST_RADIUS_PX, _LARGEST_RADIUS_PX * finer)
    top = _topmost(x, y, radius_px, width, height)      # sorted from far to near: the nearest
    covered = top >= 0
    image = np.empty((width * height, 3), np.float32)
    image[:] = background
    buffer = np.full(width * height, np.inf, np.float32)
    buffer[covered] = depth[top[covered]]
    with np.errstate(invalid="ignore"):     # inf − inf, where there is nothing
        shade = _edge_shade(buffer.reshape(height, width), np.linalg.norm(eye.target - eye.position)).ravel()
    image[covered] = colour[seen][top[covered]] * shade[covered, None]
    return _averaged(image.reshape(height, width, 3), finer).astype(np.uint8)


def draw_fog(xyz: np.ndarray, colour: np.ndarray, eye: Viewpoint, width: int, height: int, opacity: float,
             size_px: int = 1, background: tuple[int, int, int] = (0, 0, 0)) -> np.ndarray:
    """Points as specks that hide nothing: where many lie on a line of sight it glows; uint8 [height, width, 3].

    Args:
        xyz, colour, eye, width, height, background: as for draw_surface.
        opacity: of one speck, 0 … 1.
        size_px: side of the square that a speck is.
    """
    x, y, _ = project(xyz, eye, width, height)
    x, y = (np.concatenate([at + step for step in steps]) for at, steps in zip((x, y), _square(size_px)))
    colour = np.tile(colour, (size_px**2, 1))
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)      # False for NaN
    element = y[inside].astype(np.int64) * width + x[inside].astype(np.int64)
    number = np.bincount(element, minlength=width * height)
    total = np.stack([np.bincount(element, colour[inside, c], minlength=width * height) for c in range(3)], axis=1)
    mean = total / np.maximum(number, 1)[:, None]
    cover = 1 - (1 - opacity)**number[:, None]
    return (mean * cover + (1 - cover) * background).reshape(height, width, 3).astype(np.uint8)


def _square(size_px: int) -> np.ndarray:
    """Steps right and down, [2, size_px²], to the elements of a square around a point."""
    return np.mgrid[:size_px, :size_px].reshape(2, -1) - (size_px - 1) / 2


def _topmost(x: np.ndarray, y: np.ndarray, radius: np.ndarray, width: int, height: int) -> np.ndarray:
    """The last of the points whose disc covers a picture element, int32 [height · width], −1 = none."""
    elements_of_largest = (2 * np.ceil(radius.max(initial=0)) + 1)**2
    return (_topmost_of_few if len(x) < elements_of_largest else _topmost_of_many)(x, y, radius, width, height)


def _topmost_of_many(x: np.ndarray, y: np.ndarray, radius: np.ndarray, width: int, height: int) -> np.ndarray:
    """Element by element of the largest disc, all points at once.

    Of equal indices on the left of an assignment, NumPy keeps the last, and the maximum keeps what an earlier element
    of the disc has put there.
    """
    top = np.full(height * width, -1, np.int32)
    number = np.arange(len(x), dtype=np.int32)
    column, row = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
    off_x, off_y = column + np.float32(0.5) - x, row + np.float32(0.5) - y
    reach = int(np.ceil(radius.max(initial=0)))
    for dy, dx in np.ndindex(2 * reach + 1, 2 * reach + 1):
        i, j = row + (dy - reach), column + (dx - reach)
        inside = (off_x + (dx - reach))**2 + (off_y + (dy - reach))**2 <= radius**2
        inside &= (i >= 0) & (i < height) & (j >= 0) & (j < width)
        element = (i * width + j)[inside]
        top[element] = np.maximum(top[element], number[inside])
    return top


def _topmost_of_few(x: np.ndarray, y: np.ndarray, radius: np.ndarray, width: int, height: int) -> np.ndarray:
    """Point by point, all elements of its disc at once: for large discs."""
    top = np.full((height, width), -1, np.int32)
    first_col, last_col = (np.clip(np.floor(x + end * (radius + 1)), 0, width).astype(int) for end in (-1, 1))
    first_row, last_row = (np.clip(np.floor(y + end * (radius + 1)), 0, height).astype(int) for end in (-1, 1))
    across, down = np.arange(width, dtype=np.float32) + 0.5, np.arange(height, dtype=np.float32) + 0.5
    for k in range(len(x)):
        rows, cols = slice(first_row[k], last_row[k] + 1), slice(first_col[k], last_col[k] + 1)
        disc = (across[cols] - x[k])**2 + (down[rows] - y[k])[:, None]**2 <= radius[k]**2
        top[rows, cols][disc] = k
    return top.ravel()


def _edge_shade(depth: np.ndarray, distance: float) -> np.ndarray:
    """1 on smooth surfaces, less beside something nearer; float32 like `depth`, inf = nothing there."""
    light = np.ones_like(depth)
    for reach in _EDGE_REACHES:
        step = max(round(reach * depth.shape[0]), 1)
        occlusion = sum(np.clip(depth - beside, 0, _DEEPEST_EDGE * distance) for beside in _around(depth, step)) / 8
        light *= 1 - _DARKEST_EDGE * (1 - np.exp(-occlusion / (reach * _EDGE_SLOPE * distance)))
    return light


def _around(depth: np.ndarray, step: int):
    """The image shifted by `step` in eight directions; inf comes in from the borders."""
    padded = np.pad(depth, step, constant_values=np.inf)
    rows, cols = depth.shape
    for i, j in np.ndindex(3, 3):
        if (i, j) != (1, 1):
            yield padded[i * step:i * step + rows, j * step:j * step + cols]


def _averaged(image: np.ndarray, finer: int) -> np.ndarray:
    height, width, channels = image.shape
    return image.reshape(height // finer, finer, width // finer, finer, channels).mean(axis=(1, 3))
