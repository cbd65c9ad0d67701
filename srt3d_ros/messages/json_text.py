"""Untrusted JSON: bounded, strict, and checked against the fields of a schema."""

import base64
import binascii
import json
import math
from collections import Counter

import numpy as np

from srt3d_ros.errors import InvalidInput, quoted, require

MAX_BYTES = 64 * 2**20
MAX_VALUES = 2**20              # outside base64: a parsed number takes 32 bytes, a key with its value 150
EXTENSION_PREFIX = "x_"
ARRAY_KEYS = ["base64", "dtype", "shape"]


def dump(content: dict) -> str:
    """JSON on one line."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def parse(text: str, what: str) -> dict:
    """The object in a JSON text; errors call the text `what`.

    Raises:
        InvalidInput: over 64 MiB or a million values (an array in base64 is one), broken, no object, NaN, a key twice.
    """
    require(len(text) <= MAX_BYTES, what, f"{len(text)} bytes", f"at most {MAX_BYTES} bytes")
    values = sum(text.count(mark) for mark in ",[{")
    require(values <= MAX_VALUES, what, f"some {values} values", f"at most {MAX_VALUES}; write large arrays in base64")
    try:
        content = json.loads(text, object_pairs_hook=_object, parse_constant=_no_constant)
    except InvalidInput:
        raise
    except (ValueError, RecursionError) as error:
        raise InvalidInput(what, f"broken JSON ({error})", "one JSON object") from None
    require(isinstance(content, dict), what, type(content).__name__, "one JSON object")
    return content


def check_version(content: dict, schema: dict) -> None:
    """Raise InvalidInput unless `content` is of the schema's version. Call it first: other fields may have changed."""
    known = schema["schema_version"]
    said = shown(content, "schema_version")
    require(type(content.get("schema_version")) is int and said == known, "schema_version", said, str(known))


def shown(content: dict, key: str) -> object:
    """What a key holds, as messages show it: 'absent', or a text in quotes."""
    return quoted(content[key]) if key in content else "absent"


def read_object(content: dict, fields: list[dict], where: str = "") -> dict:
    """The values of the fields that are present, each of the type that the schema gives it.

    A key that is not in the schema is refused, since a misspelt optional field would change every depth in silence;
    keys that begin with `x_` belong to the writer and are left out. Messages put `where`, such as "projection.", before
    names.
    """
    known = {field["name"]: field for field in fields}
    for key in content:
        require(key in known or key.startswith(EXTENSION_PREFIX), f"{where}unknown key", quoted(key),
                f"one of {', '.join(known)}, or a name of your own that begins with {EXTENSION_PREFIX}")
    for name, field in known.items():
        require(name in content or not field["required"], where + name, "absent", f"the field (type {field['type']})")
    return {name: _value(content[name], field, where + name) for name, field in known.items() if name in content}


def write_object(value, fields: list[dict]) -> dict:
    """The fields of an object that are not None, arrays in the compact form."""
    content = {}
    for field in fields:
        part = getattr(value, field["name"])
        if part is not None:
            is_array = field["type"] == "array" and np.ndim(part) > 0
            content[field["name"]] = write_array(np.asarray(part), field["dtype"]) if is_array else part
    return content


def write_array(array: np.ndarray, dtype: str) -> dict:
    """The compact form of an array: its little-endian bytes in base64."""
    return {"dtype": dtype, "shape": list(array.shape),
            "base64": base64.b64encode(array.astype(_stored(dtype)).tobytes()).decode()}


def _value(value, field: dict, name: str):
    kind = field["type"]
    if kind == "array":
        return float(value) if field.get("or_number") and _is_number(value) else _array(value, field["dtype"], name)
    if kind == "integers":
        require(isinstance(value, list), name, quoted(value), "a list of integers")
        for number in value:
            require(_is_integer(number), name, quoted(number), "integers only")
        return [int(number) for number in value]
    fits = {"integer": _is_integer, "number": _is_number, "string": lambda v: isinstance(v, str),
            "object": lambda v: isinstance(v, dict)}[kind]
    require(fits(value), name, quoted(value), f"{'an' if kind[0] in 'io' else 'a'} {kind}")
    return int(value) if kind == "integer" else float(value) if kind == "number" else value


def _is_number(value) -> bool:
    return type(value) in (int, float) and abs(value) < 1e300


def _is_integer(value) -> bool:
    return _is_number(value) and abs(value) < 2**63 and value == int(value)


def _array(value, dtype: str, name: str) -> np.ndarray:
    array = (_from_base64 if isinstance(value, dict) else _from_lists)(value, dtype, name)
    with np.errstate(over="ignore"):        # what float32 cannot hold becomes Inf, which SensorModel refuses
        return array.astype(dtype)


def _from_lists(value, dtype: str, name: str) -> np.ndarray:
    wanted = f"nested lists of {dtype}, or an object {{{', '.join(ARRAY_KEYS)}}}"
    require(isinstance(value, list), name, quoted(value), wanted)
    # Checked one by one: NumPy would take "1.5" and true for numbers, and lists of long texts for gigabytes.
    kinds = (bool,) if dtype == "bool" else (int, float)
    for row in value if all(isinstance(row, list) for row in value) else [value]:
        for number in row:
            require(type(number) in kinds, name, quoted(number), wanted)
    try:
        return np.array(value, bool if dtype == "bool" else np.float64)
    except (ValueError, OverflowError):
        raise InvalidInput(name, "lists of unequal lengths, or numbers too large", wanted) from None


def _from_base64(value: dict, dtype: str, name: str) -> np.ndarray:
    require(sorted(value) == ARRAY_KEYS, name, f"an object of {', '.join(value)}", f"the keys {', '.join(ARRAY_KEYS)}")
    require(value["dtype"] == dtype, f"{name}.dtype", quoted(value["dtype"]), dtype)
    shape = value["shape"]
    require(isinstance(shape, list) and 0 < len(shape) <= 2 and all(_is_integer(n) and n >= 0 for n in shape),
            f"{name}.shape", quoted(shape), "a list of one or two sizes")
    require(isinstance(value["base64"], str), f"{name}.base64", value["base64"], "a string")
    try:
        raw = base64.b64decode(value["base64"], validate=True)
    except (binascii.Error, ValueError) as error:
        raise InvalidInput(f"{name}.base64", f"broken ({error})", "base64 (RFC 4648)") from None
    stored = np.dtype(_stored(dtype))
    count = math.prod(map(int, shape))
    require(len(raw) == count * stored.itemsize, f"{name}.base64", f"{len(raw)} bytes",
            f"{count} numbers of {stored.itemsize} bytes for the shape {shape}")
    array = np.frombuffer(raw, stored).reshape([int(n) for n in shape])
    require(dtype != "bool" or bool((array <= 1).all()), name, "not 0 or 1 in places", "bytes 0 and 1")
    return array


def _stored(dtype: str) -> str:
    return "u1" if dtype == "bool" else np.dtype(dtype).newbyteorder("<").str


def _object(pairs: list[tuple]) -> dict:
    content = dict(pairs)
    if len(content) < len(pairs):
        (twice, _), = Counter(name for name, _ in pairs).most_common(1)
        raise InvalidInput("repeated key", quoted(twice), "each key of an object once")
    return content


def _no_constant(text: str):
    raise InvalidInput("JSON", text, "finite numbers")
