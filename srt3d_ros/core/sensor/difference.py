"""Finds the first key in which two descriptions of a sensor differ."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

RTOL = 1e-5             # drivers print floats with six digits
Difference = tuple[str, object, object]


def first_difference(one: Any, other: Any, name: str = "", rtol: float = RTOL) -> Difference | None:
    """The first key, in the order of the schema, in which two sensors differ, and both values; None if none.

    Numbers agree within a relative `rtol`. In an array the key names the first element that differs, such as "irf[3]",
    or "irf shape". A missing value is "absent". `name` is the key of `one` and `other`, for parts of a sensor.
    """
    if one is other:            # fast: an IRF per pixel takes 10 ms
        return None
    if one is None or other is None:
        return name, _shown(one), _shown(other)
    if is_dataclass(one):
        prefix = f"{name}." if name else ""
        if type(one) is not type(other):        # pinhole and angular scan
            return f"{prefix}kind", getattr(one, "kind", ""), getattr(other, "kind", "")
        parts = (first_difference(getattr(one, field.name), getattr(other, field.name), prefix + field.name,
                                  rtol)
                 for field in fields(one))
        return next(filter(None, parts), None)
    one, other = np.asarray(one), np.asarray(other)
    if one.shape != other.shape:
        return f"{name} shape", one.shape, other.shape
    differs = np.argwhere(~np.isclose(one, other, rtol=rtol, atol=0) if one.dtype.kind == "f" else one != other)
    if not len(differs):
        return None
    place = tuple(differs[0].tolist())
    return f"{name}{list(place) or ''}", one[place].item(), other[place].item()


def _shown(value: Any) -> object:
    if value is None:
        return "absent"
    return "given" if is_dataclass(value) or isinstance(value, np.ndarray) else value
