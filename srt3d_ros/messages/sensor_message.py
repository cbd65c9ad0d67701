"""`sensor`: SensorModel ⇄ JSON text in a String (msg_schemas/sensor.json)."""

import hashlib
from functools import lru_cache
from typing import TYPE_CHECKING, get_args

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Projection
from srt3d_ros.files import json_text
from srt3d_ros.messages import cdr
from srt3d_ros.messages.cdr import check_frame_id
from srt3d_ros.messages.schema_files import load

if TYPE_CHECKING:
    from std_msgs.msg import String

OBJECTS = {"gates": GateWords, "histograms": HistogramBins}
PROJECTIONS = {kind.kind: kind for kind in get_args(Projection)}


def encode(sensor: SensorModel, **own: str) -> "String":
    """The message of a sensor; `own` adds keys, whose names must begin with `x_`."""
    from std_msgs.msg import String

    return String(data=json_text.dump(to_object(sensor) | own))


def encode_cdr(sensor: SensorModel) -> bytes:
    """`encode`, serialised."""
    return cdr.write_text(to_json(sensor))


def decode_cdr(raw: bytes) -> SensorModel:
    """The sensor of a serialised message; InvalidInput names the field that cannot be used."""
    return from_json(cdr.read_text(raw))


def to_json(sensor: SensorModel) -> str:
    """The JSON text of a sensor, arrays in base64."""
    return json_text.dump(to_object(sensor))


def from_json(text: str) -> SensorModel:
    """The sensor of a JSON text; InvalidInput names the field that cannot be used."""
    return from_object(json_text.parse(text, "sensor"))


@lru_cache(maxsize=8)
def digest(sensor: SensorModel | str) -> str:
    """The first 8 hexadecimal digits of SHA-256 of a description's JSON text, by which sketches name the description.

    Args:
        sensor: the text of a received description; or a sensor, for the text that `encode` sends.
    """
    text = sensor if isinstance(sensor, str) else to_json(sensor)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def to_object(sensor: SensorModel) -> dict:
    """The JSON object of a sensor."""
    version, *properties = load("sensor")["properties"].items()
    content = json_text.write_object(sensor, dict(properties))
    for name in OBJECTS.keys() & content.keys():
        content[name] = json_text.write_object(content[name], _properties(name))
    content["projection"] = _projection_parts(sensor.projection)
    return {version[0]: version[1]["const"]} | content


def from_object(content: dict) -> SensorModel:
    """The sensor of a parsed JSON object; InvalidInput names the field that cannot be used."""
    json_text.check(content, load("sensor"))
    values = json_text.read_object(content, load("sensor")["properties"])
    del values["schema_version"]
    for name in OBJECTS.keys() & values.keys():
        values[name] = OBJECTS[name](**json_text.read_object(values[name], _properties(name), f"{name}."))
    if "projection" in values:
        values["projection"] = _projection(values["projection"])
    check_frame_id("frame_id", values.get("frame_id", ""))
    return SensorModel(**values)


def _properties(name: str) -> dict[str, dict]:
    """The schema's properties of an object inside the sensor's."""
    return load("sensor")["$defs"][name]["properties"]


def _projection_parts(projection: Projection) -> dict:
    parts = json_text.write_object(projection, _properties(projection.kind))
    distortion = parts.pop("distortion", None)
    if distortion:
        parts["distortion"] = json_text.write_object(distortion, _properties("distortion"))
    return parts


def _projection(content: dict) -> Projection:
    values = json_text.read_object(content, _properties(content["kind"]), "projection.")
    del values["kind"]
    if "distortion" in values:
        values["distortion"] = PlumbBob(**json_text.read_object(
            values["distortion"], _properties("distortion"), "projection.distortion."))
    return PROJECTIONS[content["kind"]](**values)
