"""Read Becker & Hickl histograms (.sdt) with sdtfile, for isolated_child.py. Imports nothing of srt3d_ros."""

import numpy as np
import sdtfile


def variables(path: str, names: tuple[str, ...]) -> tuple[dict[str, np.ndarray], list[tuple[str, tuple, str]]]:
    """Each data set of counts [rows, cols, bins] as K, from 0, and K.width, seconds of a bin or 0; and all shapes.

    A block of several detectors has as many data sets. Curves [curves, bins] are a row of pixels. `names` is not used.
    """
    found, shapes = {}, []
    with sdtfile.SdtFile(path) as file:
        for counts, times in zip(file.data, file.times, strict=True):
            if not counts.size or counts.dtype.kind not in "iu":
                continue
            for part in counts.reshape(-1, *(1, 1, *counts.shape)[-3:]):
                name = str(len(shapes))
                found |= {name: part, f"{name}.width": np.array(times[1] - times[0] if len(times) > 1 else 0.0)}
                shapes.append((name, part.shape, str(part.dtype)))
    return found, shapes
