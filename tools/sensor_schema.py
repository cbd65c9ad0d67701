"""Make msg_schemas/sensor.json and the table of docs/photon-file.md from the keys of the sensor."""

import json
from typing import Any

from srt3d_ros.core.keys import Key, about, keys
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.datasets.options import option_keys
from srt3d_ros.messages.cdr import MAX_FRAME_ID
from srt3d_ros.messages.sensor_message import VERSION
from tools.schema_tables import table

TYPES = {int: "integer", float: "number"}
OBJECTS = {"pinhole": (Pinhole, "projection"), "angular_scan": (AngularScan, "projection"),
           "distortion": (PlumbBob, "projection.distortion"), "gates": (GateWords, "gates"),
           "histograms": (HistogramBins, "histograms")}     # by their names in $defs: the class, and where it stands
ARRAY = {
    "description": "nested lists, or the bytes of the numbers, row by row, little-endian, in base64 (RFC 4648)",
    "properties": {
        "dtype": {"enum": ["float32", "bool"]},
        "shape": {"type": "array", "minItems": 1, "maxItems": 2, "x-expected": "a list of one or two sizes",
                  "items": {"type": "integer", "minimum": 0, "x-expected": "a size, 0 or more"}},
        "base64": {"type": "string"}},
    "additionalProperties": False, "required": ["dtype", "shape", "base64"]}
DTYPES = {"float32": "float", "bool": "bool"}
ONLY_IN_FILES = "period_s", "frame_id", "extrinsics", "histograms", "gates"     # told in a line
WIDTH = 118         # of a line of JSON


def schema_text() -> str:
    """The text of msg_schemas/sensor.json."""
    kinds = ("pinhole", "angular_scan")
    one_of = {"type": "object", "properties": {"kind": {"enum": kinds}}, "required": ["kind"], "allOf": [
        {"if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]}, "then": {"$ref": f"#/$defs/{kind}"}}
        for kind in kinds]}
    version = {"schema_version": {"type": "integer", "const": VERSION, "x-unit": "1", "description": str(VERSION)}}
    return _text({
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "sensor", "description": about(SensorModel),
        "x-type": "std_msgs/msg/String", "x-qos": "reliable, transient local, depth 1",
        **_object(SensorModel, version),
        "$defs": {"projection": one_of, **{name: _part(name) for name in OBJECTS}, "array": ARRAY}}) + "\n"


def _part(name: str) -> dict:
    kind, title = OBJECTS[name]
    first = {"kind": {"const": name, "description": name}} if title == "projection" else {}
    return {"title": title, "description": about(kind), **_object(kind, first)}


def _object(kind: type, first: dict) -> dict:
    """The schema of an object with the properties `first`, and then one for each key of a class."""
    own = keys(kind)
    return {"type": "object", "properties": first | {name: _property(key) for name, key in own.items()},
            "patternProperties": {"^x_": {}}, "additionalProperties": False,
            "required": [*first, *(name for name, key in own.items() if key.required)]}


def _property(key: Key) -> dict:
    if key.dtype:
        content = {"type": ["array", "object"], "$ref": "#/$defs/array", "x-dtype": key.dtype}
    elif str in key.kinds:
        content = {"type": "string", "maxLength": MAX_FRAME_ID,
                   "x-expected": f"text of at most {MAX_FRAME_ID} characters"}
    elif key.kinds[0] in TYPES:
        content = {"type": TYPES[key.kinds[0]]}
    else:
        content = {"$ref": f"#/$defs/{key.name}"}
    return content | ({"x-unit": key.unit} if key.unit else {}) | {"description": key.meaning}


def _text(value: Any, indent: str = "") -> str:
    """JSON whose objects and lists stand on one line where they fit."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict) or len(indent) + len(line) <= WIDTH:
        return line
    inner = indent + "  "
    parts = (f"{inner}{json.dumps(name)}: {_text(part, inner)}" for name, part in value.items())
    return "{\n" + ",\n".join(parts) + f"\n{indent}}}"


def photon_file_table(_: str) -> str:
    """The table of docs/photon-file.md: each option of `read`, with its array in .npz files and on the command line."""
    options, of_sensor = option_keys(), keys(SensorModel)
    return table(["option", "array in .npz", "command line", "meaning"], [
        [f"`{name}`", _array(name, of_sensor[name]) if name in of_sensor else "",
         f"`--{name.replace('_', '-')}`" if name in options and key.option else "", key.meaning]
        for name, key in (options | of_sensor | options).items() if name not in ONLY_IN_FILES])


def _array(name: str, key: Key) -> str:
    """Dtype, shape and, if it is another, the name of a key's array."""
    if key.dtype:
        text = f"{DTYPES[key.dtype]} {key.shape}"
    elif key.kinds[0] in TYPES or str in key.kinds:
        text = {int: "integer", float: "float", str: "text"}[key.kinds[0]]
    else:
        parts = [[part for part, one in keys(kind).items() if not one.array] for kind in key.kinds]
        text = f"`{key.array}`: " + " or ".join(f"[{', '.join(names)}]" for names in parts)
    return text + ", required" * key.required
