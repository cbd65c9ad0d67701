"""Convert arrays of files and callers to NumPy arrays of numbers."""

from typing import Any

import numpy as np

from srt3d_ros.core.sketching.photon_frame import COUNT_DTYPES
from srt3d_ros.errors import InvalidInput, require

MAX_EVENTS = 2**28         # of a frame, one by one


def array(name: str, values: Any) -> np.ndarray:
    """Values as a NumPy array of numbers; a tensor is copied from its device. Errors call it `name`."""
    require(not np.ma.is_masked(values), name, problem=f"{name} has masked values: fill them or leave them out.")
    try:
        found = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(name, f"{type(values).__name__} ({error})", "an array of numbers") from None
    require(found.dtype.kind in "biuf", f"{name} dtype", str(found.dtype), "numbers")
    return found


def sendable(counts: np.ndarray) -> np.ndarray:
    """Counts in one of COUNT_DTYPES: floats as float32, integers in the smallest type that holds them."""
    if counts.dtype in COUNT_DTYPES and counts.dtype.isnative:
        return counts
    if counts.dtype.kind == "f":
        return counts.astype(np.float32)
    low, high = (int(counts.min()), int(counts.max())) if counts.size else (0, 0)
    kind = next((kind for kind in COUNT_DTYPES[:-1] if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max), None)
    require(kind is not None, "counts", low if low < 0 else high, "32-bit numbers")
    return counts.astype(kind)
