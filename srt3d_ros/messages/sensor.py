"""`sensor`: SensorModel ⇄ JSON in a String (msg_schemas/sensor.json)."""

from typing import TYPE_CHECKING

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.histogram_bins import HistogramBins
from srt3d_ros.core.projection import AngularScan, Pinhole, Projection
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.errors import require
from srt3d_ros.messages import cdr, json_text
from srt3d_ros.messages.cdr import check_frame_id
from srt3d_ros.messages.schema import load

if TYPE_CHECKING:
    from std_msgs.msg import String

OBJECTS = {"gates": GateWords, "histograms": HistogramBins}
PROJECTIONS = {kind.kind: kind for kind in (Pinhole, AngularScan)}


def encode(sensor: SensorModel, **own: str) -> "String":
    """The message of a sensor, with keys of the writer's own that begin with `x_`."""
    from std_msgs.msg import String

    return String(data=json_text.dump(to_object(sensor) | own))


def decode(message: "String") -> SensorModel:
    """The sensor of a message; InvalidInput names the field that cannot be used."""
    return from_json(message.data)


def encode_cdr(sensor: SensorModel) -> bytes:
    """`encode`, serialised."""
    return cdr.write_text(to_json(sensor))


def decode_cdr(raw: bytes) -> SensorModel:
    """`decode` of a serialised message."""
    return from_json(cdr.read_text(raw))


def to_json(sensor: SensorModel) -> str:
    """The JSON text of a sensor, arrays in base64."""
    return json_text.dump(to_object(sensor))


def from_json(text: str) -> SensorModel:
    """The sensor of a JSON text; InvalidInput names the field that cannot be used."""
    return from_object(json_text.parse(text, "sensor"))


def to_object(sensor: SensorModel) -> dict:
    """The JSON object of a sensor."""
    schema = load("sensor")
    content = {"schema_version": schema["schema_version"]}
    for field in schema["fields"][1:]:
        value = getattr(sensor, field["name"])
        if value is None or "default" in field and value == field["default"]:
            continue
        if field["type"] == "array":
            value = json_text.write_array(value, field["dtype"])
        elif field["name"] == "projection":
            value = _projection_parts(value, schema)
        elif field["name"] in OBJECTS:
            value = json_text.write_object(value, schema[field["name"]]["fields"])
        content[field["name"]] = value
    return content


def from_object(content: dict) -> SensorModel:
    """The sensor of a parsed JSON object; InvalidInput names the field that cannot be used."""
    schema = load("sensor")
    json_text.check_version(content, schema)
    values = json_text.read_object(content, schema["fields"])
    del values["schema_version"]
    for name in OBJECTS.keys() & values.keys():
        values[name] = OBJECTS[name](**json_text.read_object(values[name], schema[name]["fields"], f"{name}."))
    if "projection" in values:
        values["projection"] = _projection(values["projection"], schema)
    check_frame_id("frame_id", values.get("frame_id", ""))
    return SensorModel(**values)


def _projection_parts(projection: Projection, schema: dict) -> dict:
    parts = json_text.write_object(projection, schema["projection"][projection.kind]["fields"])
    distortion = parts.pop("distortion", None)
    if distortion:
        parts["distortion"] = json_text.write_object(distortion, schema["distortion"]["fields"])
    return parts


def _projection(content: dict, schema: dict) -> Projection:
    kind, kinds = content.get("kind"), schema["projection"]
    known = isinstance(kind, str) and kind in kinds
    require(known, "projection.kind", json_text.shown(content, "kind"), " or ".join(kinds))
    values = json_text.read_object(content, kinds[kind]["fields"], "projection.")
    del values["kind"]
    if "distortion" in values:
        values["distortion"] = PlumbBob(**json_text.read_object(
            values["distortion"], schema["distortion"]["fields"], "projection.distortion."))
    return PROJECTIONS[kind](**values)
