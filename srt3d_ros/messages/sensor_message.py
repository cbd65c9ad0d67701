"""`sensor`: SensorModel ⇄ JSON text in a String (msg_schemas/sensor.json)."""

import hashlib
from dataclasses import is_dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from srt3d_ros.core.keys import Key, keys
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import quoted, require
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr
from srt3d_ros.messages.cdr import MAX_FRAME_ID, check_frame_id

VERSION = 1         # of the schema


def encode_cdr(sensor: SensorModel, **own: str) -> bytes:
    """The serialised message of a sensor; `own` adds keys, whose names must begin with `x_`."""
    return cdr.write_text(json_text.dump(to_object(sensor) | own))


def decode_cdr(raw: bytes) -> SensorModel:
    """The sensor of a serialised message; InvalidInput names the field that cannot be used."""
    return from_json(cdr.read_text(raw))


def to_json(sensor: SensorModel) -> str:
    """The JSON text of a sensor, arrays in base64."""
    return json_text.dump(to_object(sensor))


def from_json(text: str) -> SensorModel:
    """The sensor of a JSON text; InvalidInput names the field that cannot be used."""
    content = json_text.parse(text, "sensor")
    version = content.pop("schema_version", "absent")
    require(version == VERSION, "schema_version", version, str(VERSION))
    sensor = _read(content, (SensorModel,))
    check_frame_id("frame_id", sensor.frame_id)
    return sensor


@lru_cache(maxsize=8)
def digest(sensor: SensorModel | str) -> str:
    """The first 8 hexadecimal digits of SHA-256 of a description's JSON text, by which sketches name the description.

    Args:
        sensor: the text of a received description; or a sensor, for the text that `encode_cdr` sends.
    """
    text = sensor if isinstance(sensor, str) else to_json(sensor)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def to_object(sensor: SensorModel) -> dict:
    """The JSON object of a sensor."""
    return {"schema_version": VERSION} | _written(sensor)


def _written(part: Any) -> dict:
    """The values of a sensor, or of an object inside it, that are there: arrays in base64, objects as dicts."""
    content = {"kind": part.kind} if hasattr(part, "kind") else {}
    for name, key in keys(type(part)).items():
        value = getattr(part, name)
        if value is None or (is_dataclass(value) and not value):        # no distortion
            continue
        content[name] = json_text.write_array(np.asarray(value), key.dtype) if key.dtype else \
            _written(value) if is_dataclass(value) else value
    return content


def _read(content: Any, kinds: tuple[type, ...], where: str = "") -> Any:
    """An object of one of these classes; `where`, such as "projection.", stands in front of the names in errors."""
    require(isinstance(content, dict), where.removesuffix("."), quoted(content), "an object")
    if hasattr(kinds[0], "kind"):
        named = {kind.kind: kind for kind in kinds}
        chosen = content.get("kind")
        require(chosen in named, f"{where}kind", quoted(chosen) if "kind" in content else "absent", " or ".join(named))
        kinds, content = (named[chosen],), {name: value for name, value in content.items() if name != "kind"}
    known, values = keys(kinds[0]), {}
    for name in content:
        require(name in known or name.startswith("x_"), f"{where}unknown key", quoted(name),
                f"one of {', '.join(known)}, or a name of your own that begins with x_")
    for name, key in known.items():
        if name in content:
            values[name] = _value(content[name], key, where)
        else:
            require(not key.required, where + name, "absent", key.expected)
    return kinds[0](**values)


def _value(value: Any, key: Key, where: str) -> Any:
    name = where + key.name
    if key.dtype:
        return json_text.read_array(value, key.dtype, name)
    if is_dataclass(key.kinds[0]):
        return _read(value, key.kinds, f"{name}.")
    if str in key.kinds:
        require(isinstance(value, str) and len(value) <= MAX_FRAME_ID, name, quoted(value),
                f"text of at most {MAX_FRAME_ID} characters")
        return value
    require(type(value) in (int, float), name, quoted(value), key.expected)
    return key.number(value, where)
