"""Parse untrusted JSON with limits, check it by a JSON Schema, and convert its arrays (lists or base64)."""

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
MAX_KEYS = 1000                 # in an object: the schema is checked key by key, 7 s a million
MAX_NUMBER = 1e300
IN_WORDS = {"integer": "an integer", "number": "a number", "string": "a string", "array": "a list"}


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


def check(content: dict, schema: dict) -> None:
    """Raise InvalidInput for the first error that a JSON Schema finds in a parsed object."""
    from jsonschema import Draft202012Validator  # imported here: takes 50 ms

    try:
        error = next(Draft202012Validator(schema).iter_errors(content), None)
    except RecursionError:
        raise InvalidInput(schema["title"], problem=f"{schema['title']} is nested too deeply.") from None
    if error is not None:
        raise _in_one_line(error)


def read_object(content: dict, properties: dict[str, dict], where: str = "") -> dict:
    """Values of a checked object by the properties of its schema: arrays, int, float, str and dict.

    Skips keys that the schema does not list (`x_…`). Errors put `where`, such as "projection.", in front of names.
    """
    return {name: _value(content[name], schema, where + name) for name, schema in properties.items() if name in content}


def write_object(value: Any, properties: dict[str, dict]) -> dict:
    """A dict of the attributes that are not None, with arrays in base64."""
    content = {}
    for name, schema in properties.items():
        part = getattr(value, name)
        if part is not None:
            content[name] = _to_base64(np.asarray(part), schema["x-dtype"]) if np.ndim(part) > 0 else part
    return content


def _in_one_line(error: Any) -> InvalidInput:
    """An error of jsonschema as InvalidInput."""
    where, keyword, schema = list(error.absolute_path), error.validator, error.schema
    value, expected = quoted(error.instance), _expected(schema)
    if keyword == "required":
        missing = next(key for key in error.validator_value if key not in error.instance)
        where, value = [*where, missing], "absent"
        expected = _expected(schema.get("properties", {}).get(missing, {}))
    elif keyword == "additionalProperties":
        known, own = schema["properties"], "patternProperties" in schema
        unknown = next(key for key in error.instance if key not in known and not (own and key.startswith("x_")))
        where, value = [*where, "unknown key"], quoted(unknown)
        expected = f"one of {', '.join(known)}"
        if own:
            expected += ", or a name of your own that begins with x_"
    return InvalidInput(".".join(map(str, where)), value, expected)


def _expected(schema: dict) -> str:
    """What a schema accepts, in words."""
    if "enum" in schema or "const" in schema:
        return " or ".join(map(str, schema.get("enum", [schema.get("const")])))
    if "x-dtype" in schema:
        return f"nested lists of {schema['x-dtype']}, or an object {{dtype, shape, base64}}"
    return schema.get("x-expected") or IN_WORDS.get(schema.get("type"), "an object")


def _value(value: Any, schema: dict, name: str) -> Any:
    kind = schema.get("type")
    if "x-dtype" in schema and isinstance(value, (list, dict)):
        array = _from_base64(value, schema, name) if isinstance(value, dict) else _from_lists(value, schema, name)
        with np.errstate(over="ignore"):        # float32 overflows to Inf, which SensorModel refuses
            return array.astype(schema["x-dtype"])
    if isinstance(value, (int, float)):
        require(abs(value) < MAX_NUMBER, name, value, _expected(schema))
        return int(value) if kind == "integer" else float(value)
    return value


def _from_lists(value: list, schema: dict, name: str) -> np.ndarray:
    # Check types one by one: NumPy accepts "1.5" and true as numbers, and long texts would take gigabytes.
    kinds = (bool,) if schema["x-dtype"] == "bool" else (int, float)
    for row in value if all(isinstance(row, list) for row in value) else [value]:
        for number in row:
            require(type(number) in kinds, name, quoted(number), _expected(schema))
    try:
        return np.array(value, bool if kinds == (bool,) else np.float64)
    except (ValueError, OverflowError):
        raise InvalidInput(name, problem=f"{name} has lists of unequal length, or numbers too large.") from None


def _from_base64(value: dict, schema: dict, name: str) -> np.ndarray:
    dtype, shape = schema["x-dtype"], [int(size) for size in value["shape"]]
    require(value["dtype"] == dtype, f"{name}.dtype", value["dtype"], dtype)
    try:
        raw = base64.b64decode(value["base64"], validate=True)
    except (binascii.Error, ValueError) as error:
        raise InvalidInput(f"{name}.base64", f"broken ({error})", "base64 (RFC 4648)") from None
    count, stored = math.prod(shape), np.dtype(_stored(dtype))
    require(len(raw) == count * stored.itemsize, f"{name}.base64", f"{len(raw)} bytes",
            f"{count} numbers of {stored.itemsize} bytes for the shape {shape}")
    array = np.frombuffer(raw, stored).reshape(shape)
    require(dtype != "bool" or bool((array <= 1).all()), name, problem=f"{name} has bytes other than 0 and 1.")
    return array


def _to_base64(array: np.ndarray, dtype: str) -> dict:
    return {"dtype": dtype, "shape": list(array.shape),
            "base64": base64.b64encode(array.astype(_stored(dtype)).tobytes()).decode()}


def _stored(dtype: str) -> str:
    return "u1" if dtype == "bool" else np.dtype(dtype).newbyteorder("<").str


def _object(pairs: list[tuple]) -> dict:
    require(len(pairs) <= MAX_KEYS, "number of keys", len(pairs), f"at most {MAX_KEYS}")
    content = dict(pairs)
    if len(content) < len(pairs):
        (twice, _), = Counter(name for name, _ in pairs).most_common(1)
        raise InvalidInput("repeated key", quoted(twice), "each key of an object once")
    return content


def _no_constant(text: str) -> None:
    raise InvalidInput("JSON", text, "finite numbers")
