"""Photons of the raw words of a SPAD array: a ToA word for each frame and pixel."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from srt3d_ros.core.sensor.model import MAX_BINS
from srt3d_ros.datasets.arrays import from_pixels
from srt3d_ros.datasets.options import FRAMES, Options, check_same, replaced_note
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import finite, require

AXES = (FRAMES, "rows", "cols")
AT_ONCE = 2**24             # words
MUCH_PILE_UP = 0.05         # photons a pixel and frame, above which early photons hide late ones


def read(path: Path, words: np.ndarray, options: Options, stated: dict[str, Any]) -> Reading:
    """Photons of words [frames, rows, cols], or in the order of `axes`: ToA = word − `first_word`.

    A word `no_detection`, or NaN, is no photon; one that is no bin is dropped, and a note counts them.

    Args:
        stated: what the file says of its sensor, by the names of options.
    """
    order = options.axes or AXES
    fits = words.ndim == 3 and words.dtype.kind in "iuf" and words.size > 0
    require(fits, "words", f"{words.dtype} {words.shape}", "numbers [frames, rows, cols]")
    require({*order} == {*AXES}, "axes", ",".join(order), f"{', '.join(AXES)} in the order of the array of words")
    words = words.transpose([order.index(name) for name in AXES])
    frames, rows, cols = words.shape
    check_same({"rows": rows, "cols": cols}, options.known)
    none, first = (finite(name, getattr(options, name) or 0) for name in ("no_detection", "first_word"))
    pixels, toas, step = [], [], max(AT_ONCE // (rows * cols), 1)
    for begin in range(0, frames, step):
        part = words[begin:begin + step].reshape(-1, rows * cols)
        at = np.nonzero((part != none) & ~np.isnan(part))
        pixels.append(at[1].astype(np.uint32))
        toas.append(np.clip(part[at].astype(np.float64) - first, -1, MAX_BINS).astype(np.float32))
        require(sum(map(len, toas)) <= MAX_EVENTS, "photons", f"more than {MAX_EVENTS}", "fewer: leave frames out")
    pixel, toa = np.concatenate(pixels), np.concatenate(toas)
    by_pixel = np.argsort(pixel, kind="stable")         # sketched several times faster
    chosen = replace(options.without("axes", "no_detection", "first_word", "gate"),
                     known=stated | options.known | {"rows": rows, "cols": cols})
    sensor, events, notes = from_pixels(pixel[by_pixel], toa[by_pixel], 0, chosen)
    notes += replaced_note(stated, options.known)
    share = events.photons / words.size
    if share > MUCH_PILE_UP and not sensor.cycles:
        notes += (f"{share:.0%} of the words are photons: if a frame is one laser cycle, give cycles={frames} "
                  "(--cycles) to correct pile-up",)
    reading = Reading(sensor, events, None, path.stem, notes)
    return reading if options.gate is None else reading.gated(*options.gate)
