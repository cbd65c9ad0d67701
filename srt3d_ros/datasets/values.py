"""Values from files and callers, checked: numbers, arrays, counts."""

from typing import Any

import numpy as np

from srt3d_ros.core.sketching.photon_frame import COUNT_DTYPES
from srt3d_ros.errors import InvalidInput, require

MAX_PHOTONS = 2**28


def array(name: str, values: Any) -> np.ndarray:
    """Values as a NumPy array of numbers; a tensor is copied from its device."""
    try:
        found = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(name, f"{type(values).__name__} ({error})", "an array of numbers") from None
    require(found.dtype.kind in "biuf", f"{name} dtype", str(found.dtype), "numbers")
    return found


def sendable(counts: np.ndarray) -> np.ndarray:
    """Counts in a type that histograms may have: of integers the smallest that holds them."""
    if counts.dtype in COUNT_DTYPES and counts.dtype.isnative:
        return counts
    if counts.dtype.kind == "f":
        return counts.astype(np.float32)
    low, high = (int(counts.min()), int(counts.max())) if counts.size else (0, 0)
    kind = next((kind for kind in COUNT_DTYPES[:-1] if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max), None)
    require(kind is not None, "counts", low if low < 0 else high, "32-bit numbers")
    return counts.astype(kind)


def check_within(name: str, values: np.ndarray, end: int) -> None:
    """Raise InvalidInput unless all values are 0 or more, and below `end`."""
    if values.size:
        low, high = values.min().item(), values.max().item()        # a NaN makes both NaN
        require(0 <= low and high < end, name, low if high < end else high, f"0 to below {end}")


def whole_counts(field: str, rows: object, shape: tuple[int, ...]) -> np.ndarray:
    """Nested lists of a log as int32 counts; InvalidInput unless they are numbers of this shape, -1 for any length."""
    try:
        values = np.array(rows, np.float64)
    except (ValueError, TypeError, OverflowError):
        values = np.empty(0)
    fits = values.ndim == len(shape) and all(wanted in (-1, found) for wanted, found in zip(shape, values.shape))
    sizes = " × ".join("n" if wanted < 0 else str(wanted) for wanted in shape)
    require(fits and values.size > 0 and bool((np.abs(values) < 2**31).all()), field, f"{values.shape} values",
            f"{sizes} whole numbers")
    return values.astype(np.int32)
