"""In which key two descriptions of a sensor differ."""

from dataclasses import fields, is_dataclass

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel

RTOL = 1e-5             # drivers print floats to six digits
Difference = tuple[str, object, object]


def first_difference(one: SensorModel, other: SensorModel) -> Difference | None:
    """The first key, in the order of the schema, that the two describe differently, and both values; None if none does.

    Numbers are the same to a relative RTOL. Of an array the key names the first element that differs, as in
    "irf[3]", or "irf shape". A value that is left out is "absent".
    """
    return _difference("", one, other)


def _difference(name: str, one, other) -> Difference | None:
    if one is None or other is None:
        return None if one is other else (name, _shown(one), _shown(other))
    if is_dataclass(one):
        prefix = f"{name}." if name else ""
        if type(one) is not type(other):        # pinhole and angular scan
            return f"{prefix}kind", one.kind, other.kind
        parts = (_difference(prefix + field.name, getattr(one, field.name), getattr(other, field.name))
                 for field in fields(one))
        return next(filter(None, parts), None)
    if np.shape(one) != np.shape(other):
        return f"{name} shape", np.shape(one), np.shape(other)
    if isinstance(one, np.ndarray):
        differs = np.argwhere(~np.isclose(one, other, rtol=RTOL, atol=0))
        place = tuple(differs[0].tolist()) if len(differs) else ()
        return (f"{name}{list(place)}", one[place].item(), other[place].item()) if place else None
    same = one == other if isinstance(one, (str, int)) else np.isclose(one, other, rtol=RTOL, atol=0)
    return None if same else (name, one, other)


def _shown(value):
    if value is None:
        return "absent"
    return "given" if is_dataclass(value) or isinstance(value, np.ndarray) else value
