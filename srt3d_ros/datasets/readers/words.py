"""Photons of the raw words of a SPAD array: a ToA word for each frame and pixel."""

import numpy as np

from srt3d_ros.datasets.axes import choose
from srt3d_ros.datasets.options import FRAMES, Options
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import finite, require

AXES = (FRAMES, "rows", "cols")
AT_ONCE = 2**24             # words
MUCH_PILE_UP = 0.05         # photons a pixel and frame, above which early photons hide late ones


def photons(arrays: dict[str, np.ndarray], options: Options, wanted: str, listed: str
            ) -> tuple[dict[str, np.ndarray], Options]:
    """The arrays of a photon file with the photons of an array of words [frames, rows, cols], or ordered as `axes`.

    ToA = word − `first_word`. A word `no_detection`, or NaN, is no photon.

    Args:
        wanted, listed: what the file should have, and what it has, for an error.

    Returns:
        all arrays, and the options that were not needed.
    """
    name, options = choose(arrays, options, wanted, listed)
    words, order = arrays[name], options.axes or AXES
    fits = words.ndim == 3 and words.dtype.kind in "iuf" and words.size > 0
    require(fits, "words", f"{words.dtype} {words.shape}", "numbers [frames, rows, cols]")
    require({*order} == {*AXES}, "axes", ",".join(order), f"{', '.join(AXES)} in the order of the array of words")
    words = words.transpose([order.index(name) for name in AXES])
    frames, rows, cols = words.shape
    none, first = (finite(name, getattr(options, name) or 0) for name in ("no_detection", "first_word"))
    pixels, toas, step = [], [], max(AT_ONCE // (rows * cols), 1)
    for begin in range(0, frames, step):
        part = words[begin:begin + step].reshape(-1, rows * cols)
        at = np.nonzero((part != none) & ~np.isnan(part))
        pixels.append(at[1].astype(np.uint32))
        toas.append((part[at].astype(np.float64) - first).astype(np.float32))
        require(sum(map(len, toas)) <= MAX_EVENTS, "photons", f"more than {MAX_EVENTS}", "fewer: leave frames out")
    pixel, toa = np.concatenate(pixels), np.concatenate(toas)
    by_pixel = np.argsort(pixel, kind="stable")         # sketched several times faster
    arrays = arrays | {"pixel": pixel[by_pixel], "toa": toa[by_pixel], "rows": np.array(rows), "cols": np.array(cols)}
    share = len(toa) / words.size
    if share > MUCH_PILE_UP and not options.known.get("cycles"):
        arrays["notes"] = np.array([f"{share:.0%} of the words are photons: if a frame is one laser cycle, give "
                                    f"cycles={frames} (--cycles) to correct pile-up"])
    return arrays, options.without("axes", "no_detection", "first_word")
