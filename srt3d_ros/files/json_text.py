"""Parse untrusted JSON with limits; arrays in it are nested lists, or base64."""

import base64
import binascii
import json
import math
from collections import Counter
from typing import Any

import numpy as np

from srt3d_ros.errors import InvalidInput, quoted, require

MAX_JSON_BYTES = 64 * 2**20
MAX_VALUES = 2**20              # a parsed number takes 32 bytes, a key with its value 150; base64 is one value


def dump(content: dict) -> str:
    """JSON on one line."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def parse(text: str, what: str) -> dict:
    """The object in a JSON text called `what`; InvalidInput if it is broken, too large, or repeats a key."""
    require(len(text) <= MAX_JSON_BYTES, what, f"{len(text)} bytes", f"at most {MAX_JSON_BYTES} bytes")
    values = sum(text.count(mark) for mark in ",[{")
    require(values <= MAX_VALUES, what, f"about {values} values", f"at most {MAX_VALUES}; write large arrays in base64")
    try:
        content = json.loads(text, object_pairs_hook=_object, parse_constant=_no_constant)
    except InvalidInput:
        raise
    except (ValueError, RecursionError) as error:
        raise InvalidInput(what, f"broken JSON ({error})", "one JSON object") from None
    require(isinstance(content, dict), what, type(content).__name__, "one JSON object")
    return content


def write_array(array: np.ndarray, dtype: str) -> dict:
    """An array as an object with its bytes, row by row, little-endian, in base64 (RFC 4648)."""
    return {"dtype": dtype, "shape": list(array.shape),
            "base64": base64.b64encode(array.astype(_stored(dtype)).tobytes()).decode()}


def read_array(value: Any, dtype: str, name: str) -> np.ndarray:
    """The array of nested lists of numbers, or of what `write_array` gives; InvalidInput names what is wrong."""
    expected = f"nested lists of {dtype}, or an object {{dtype, shape, base64}}"
    require(isinstance(value, list | dict), name, quoted(value), expected)
    if isinstance(value, dict):
        return _from_base64(value, dtype, name).astype(dtype)
    # Check types one by one: NumPy accepts "1.5" and true as numbers, and long texts would take gigabytes.
    kinds = (bool,) if dtype == "bool" else (int, float)
    for row in value if all(isinstance(row, list) for row in value) else [value]:
        for number in row:
            require(type(number) in kinds, name, quoted(number), expected)
    try:
        with np.errstate(over="ignore"):        # float32 overflows to Inf, which SensorModel refuses
            return np.array(value, bool if kinds == (bool,) else np.float64).astype(dtype)
    except (ValueError, OverflowError):
        raise InvalidInput(name, problem=f"{name} has lists of unequal length, or numbers too large.") from None


def _from_base64(value: dict, dtype: str, name: str) -> np.ndarray:
    keys = {"dtype": dtype, "shape": "a list of one or two sizes", "base64": "base64 (RFC 4648)"}
    for key, expected in keys.items():
        require(key in value, f"{name}.{key}", "absent", expected)
    for key in value:
        require(key in keys, f"{name}.unknown key", quoted(key), f"one of {', '.join(keys)}")
    require(value["dtype"] == dtype, f"{name}.dtype", quoted(value["dtype"]), dtype)
    shape = value["shape"]
    fits = isinstance(shape, list) and len(shape) in (1, 2) and all(type(size) is int and size >= 0 for size in shape)
    require(fits, f"{name}.shape", quoted(shape), "a list of one or two sizes")
    try:
        raw = base64.b64decode(value["base64"], validate=True)
    except (binascii.Error, TypeError, ValueError) as error:
        raise InvalidInput(f"{name}.base64", f"broken ({error})", "base64 (RFC 4648)") from None
    count, stored = math.prod(shape), np.dtype(_stored(dtype))
    require(len(raw) == count * stored.itemsize, f"{name}.base64", f"{len(raw)} bytes",
            f"{count} numbers of {stored.itemsize} bytes for the shape {shape}")
    array = np.frombuffer(raw, stored).reshape(shape)
    require(dtype != "bool" or bool((array <= 1).all()), name, problem=f"{name} has bytes other than 0 and 1.")
    return array


def _stored(dtype: str) -> str:
    return "u1" if dtype == "bool" else np.dtype(dtype).newbyteorder("<").str


def _object(pairs: list[tuple]) -> dict:
    content = dict(pairs)
    if len(content) < len(pairs):
        (twice, _), = Counter(name for name, _ in pairs).most_common(1)
        raise InvalidInput("repeated key", quoted(twice), "each key of an object once")
    return content


def _no_constant(text: str) -> None:
    raise InvalidInput("JSON", text, "finite numbers")
