"""Arrays that callers give, checked."""

from typing import Any

import numpy as np

from srt3d_ros.errors import InvalidInput, require


def as_array(name: str, values: Any, sides: int, kinds: str) -> np.ndarray:
    """Values as an array of so many dimensions, its dtype of one of these kinds; InvalidInput for others."""
    expected = f"an array of {sides} dimensions of {'complex ' if kinds == 'c' else ''}numbers"
    try:
        array = np.asarray(values)
    except ValueError:          # lists of different lengths
        raise InvalidInput(name, type(values).__name__, expected) from None
    require(array.ndim == sides and array.dtype.kind in kinds, name, f"{array.dtype} {array.shape}", expected)
    return array
