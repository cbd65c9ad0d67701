"""Map values to colours, for recordings, pictures and .ply files. NumPy only."""

import numpy as np

# Every 15th of 256 colours of the maps by van der Walt, Smith and Firing (CC0): perceptually even, readable with any
# colour vision.
_ANCHORS = {
    "viridis": "440154 481769 472a7a 433d84 3d4e8a 355e8d 2e6d8e 297b8e 23898e "
               "1f978b 21a585 2eb37c 46c06f 65cb5e 89d548 b0dd2f d8e219 fde725",
    "inferno": "000004 0a0722 1e0c45 380962 510e6c 69166e 801f6c 982766 b0315b "
               "c63d4d d94d3d e9612b f47918 fa9407 fcb014 f8cd37 f2ea69 fcffa4",
}
# Okabe and Ito (2008): distinct for any colour vision; all but black and yellow are visible on white and on black.
ORANGE, SKY_BLUE, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#f0e442"
BLUE, VERMILION, PURPLE, BLACK = "#0072b2", "#d55e00", "#cc79a7", "#000000"
RANGE_MAP, PHOTON_MAP = "viridis", "inferno"
BACKGROUND = (13, 16, 21)       # almost black; also where there is no value
_LEAST_BRIGHT = 132     # brightest channel of the darkest colour that is visible on BACKGROUND
_DARKEST = 0.5          # brightness of the points with the lowest intensity: their range can still be told
_RANGE_SAMPLES = 4096
_PERCENTILES = 2, 98     # the ends of a range
_RANGE_RATE = 0.1       # share of the way to a new frame's range that AdaptiveRange moves


def colour_table(name: str) -> np.ndarray:
    """A colour map as uint8 [256, 3]."""
    anchors = np.frombuffer(bytes.fromhex(_ANCHORS[name]), np.uint8).reshape(-1, 3)
    position = np.linspace(0, 255, len(anchors))
    return np.rint([np.interp(np.arange(256), position, channel) for channel in anchors.T]).T.astype(np.uint8)


def _visible(name: str) -> np.ndarray:
    """The part of a colour map that is visible on BACKGROUND, brightest first, uint8 [256, 3]."""
    table = colour_table(name)
    first = np.argmax(table.max(axis=1) >= _LEAST_BRIGHT)
    return table[np.rint(np.linspace(255, first, 256)).astype(int)]


RANGE_TABLE = _visible(RANGE_MAP)               # uint8 [256, 3]: near is bright
PHOTON_TABLE = _visible(PHOTON_MAP)[::-1]       # of a point's photons: many are bright
GREY_TABLE = np.linspace((34, 38, 46), (164, 170, 180), 256).astype(np.uint8)       # seen before: duller than now


def packed(colours: np.ndarray) -> np.ndarray:
    """uint8 [N, 3] as uint32 [N], 0xRRGGBBAA, opaque."""
    red, green, blue = colours.astype(np.uint32).T
    return red << 24 | green << 16 | blue << 8 | 255


def levels(values: np.ndarray, ends: tuple[float, float] | None = None, root: bool = False) -> np.ndarray:
    """Indices into a colour table, uint8: up to the lower of `ends` and NaN give 0, from the upper on 255.

    Without `ends`, they are those of the values. With `root`, square roots are spread evenly, so that equal steps of
    photon counts mean equal noise.
    """
    values, bounds = np.asarray(values, np.float32), np.array(ends or percentile_range(values) or (0, 1), np.float32)
    if root:
        values, bounds = np.sqrt(np.maximum(values, 0)), np.sqrt(np.maximum(bounds, 0))
    low, high = bounds
    scaled = (values - low) * np.float32(255 / max(float(high - low), 1e-12))
    return np.nan_to_num(np.clip(scaled, 0, 255), nan=0.0).astype(np.uint8)


def shaded(colours: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Colours uint8 [..., 3] at an intensity's level, uint8 [...] from `levels`: unchanged at 255, darkest at 0."""
    return (colours * (_DARKEST + (1 - _DARKEST) * level[..., None] / np.float32(255))).astype(np.uint8)


def percentile_range(values: np.ndarray) -> tuple[float, float] | None:
    """The 2nd and 98th percentile of the finite values, sampled if there are many; None without any."""
    values = np.asarray(values).ravel()
    values = values[:: max(len(values) // _RANGE_SAMPLES, 1)]
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return None
    low, high = np.percentile(values, _PERCENTILES)
    return float(low), float(high)


class AdaptiveRange:
    """The range of a colour map, which follows the data slowly to avoid flicker."""

    def __init__(self):
        self._ends: tuple[float, float] | None = None

    def update(self, values: np.ndarray) -> tuple[float, float]:
        """Adapt to a frame's values and give its (low, high); (0, 1) before the first finite value."""
        if seen := percentile_range(values):
            (low, high), (seen_low, seen_high) = self._ends or seen, seen
            self._ends = low + _RANGE_RATE * (seen_low - low), high + _RANGE_RATE * (seen_high - high)
        return self._ends or (0.0, 1.0)
