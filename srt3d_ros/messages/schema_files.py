"""Reads the JSON Schemas in msg_schemas/, which also describe the bytes of clouds and images (`x-layout`)."""

import json
from functools import cache

import numpy as np

from srt3d_ros.files import shared_file

# Name in the schemas → dtype, in the order of sensor_msgs/PointField, whose codes begin with 1.
DATATYPES = {name: np.dtype(name.lower()).newbyteorder("<") for name in (
    "INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32", "FLOAT32", "FLOAT64")}


def fields_of(kind: np.dtype) -> dict[str, tuple[np.dtype, int]]:
    """The fields of a structured dtype in order: name → dtype and offset."""
    return {name: (field[0], field[1]) for name, field in (kind.fields or {}).items()}


@cache
def load(name: str) -> dict:
    """The schema `msg_schemas/<name>.json` from the source tree or from share/srt3d_ros. Do not modify the result."""
    path = shared_file(f"msg_schemas/{name}.json")
    if path is None:
        raise FileNotFoundError(f"msg_schemas/{name}.json is in no folder above {__file__}: install srt3d_ros again")
    return json.loads(path.read_text(encoding="utf-8"))


@cache
def cloud_layouts(name: str) -> dict[str, np.dtype]:
    """The layouts of a PointCloud2 topic by name, each as the dtype of a point."""
    return {key: np.dtype({
        "names": [field["name"] for field in layout["fields"]],
        "formats": [DATATYPES[field["datatype"]] for field in layout["fields"]],
        "offsets": [field["offset"] for field in layout["fields"]],
        "itemsize": layout["point_step"],
    }) for key, layout in load(name)["x-layout"]["layouts"].items()}


@cache
def encodings(name: str, channels: int = 1) -> dict[str, np.dtype]:
    """The encodings of an Image topic with this number of channels, each with its dtype."""
    return {encoding.replace("Cn", f"C{channels}"): DATATYPES[kind]
            for encoding, kind in load(name)["x-layout"]["encodings"].items()}
