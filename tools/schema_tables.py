"""The tables of msg_schemas/README.md, from the schemas; tools/generate_docs.py writes them."""

import json
import re
from collections.abc import Callable
from pathlib import Path

SCHEMAS = Path(__file__).resolve().parents[1] / "msg_schemas"
MARKED = re.compile(r"(<!-- tables of (\w+)(?:\.json)? -->\n).*?(<!-- end -->)", re.DOTALL)
PIPE = "\\|"              # in a cell


def readme() -> str:
    """msg_schemas/README.md with its tables as the schemas say."""
    return filled(SCHEMAS / "README.md", tables)


def filled(page: Path, make: Callable[[str], str]) -> str:
    """A page with what `make` makes of each name between its marks."""
    return MARKED.sub(lambda found: found[1] + make(found[2]) + found[3], page.read_text(encoding="utf-8"))


def tables(name: str) -> str:
    """All tables of one schema."""
    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    make = {"sensor_msgs/msg/PointCloud2": cloud_tables, "sensor_msgs/msg/Image": image_tables,
            "std_msgs/msg/String": json_tables}[schema["type"]]
    return f"{schema['purpose']}\n`{schema['type']}`, schema version {schema['schema_version']}; {make(schema)}"


def cloud_tables(schema: dict) -> str:
    """The layouts of a PointCloud2 topic and one byte table of all, in which a field that several share is one row."""
    layouts = schema["layouts"]
    purposes = "".join(f"* **{name}**, `point_step` {layout['point_step']}: {layout['purpose']}\n"
                       for name, layout in layouts.items())
    shared: dict[tuple, list[str]] = {}
    for name, layout in layouts.items():
        for field in layout["fields"]:
            row = (field["offset"], _size(field), f"`{field['name']}`", field["datatype"], field["count"],
                   field["unit"], field["meaning"])
            shared.setdefault(row, []).append(name)
    rows = [[", ".join(names), *row] for row, names in shared.items()]
    inside = "".join(f"The bytes of {name}, little-endian:\n\n" + table(
        ["byte", "datatype", "count", "name", "unit", "meaning"],
        [[part[key] for key in ("offset", "datatype", "count", "name", "unit", "meaning")] for part in layout["bytes"]])
        for name, layout in layouts.items() if "bytes" in layout)
    return f"`height` {schema['height']}; `width` {schema['width']}.\n\n{purposes}\n" + table(
        ["layout", "byte", "size", "field", "datatype", "count", "unit", "meaning"], rows) + inside


def _size(field: dict) -> int | str:
    one, count = _bytes(field["datatype"]), field["count"]
    return one * count if isinstance(count, int) else f"{one * int(count.removesuffix('m'))}m"


def _bytes(datatype: str) -> int:
    return int(re.sub(r"\D", "", datatype)) // 8


def image_tables(schema: dict) -> str:
    """What an Image topic holds."""
    pixel = schema["pixel"]
    topics = schema.get("topics", {schema.get("topic"): pixel})
    encodings = " or ".join(f"`{encoding}` ({kind})" for encoding, kind in schema["encodings"].items())
    return (f"`height` {schema['height']}; `width` {schema['width']}; `encoding` {encodings}.\n\n"
            + table(["topic", "unit", "meaning of a pixel"],
                    [[f"`{name}`", topic["unit"], topic["meaning"]] for name, topic in topics.items()]))


def json_tables(schema: dict) -> str:
    """The keys of a JSON topic, those of the objects in it, and what these objects are."""
    rows, notes = _keys(schema["fields"]), []
    for kind, projection in schema.get("projection", {}).items():
        rows += _keys(projection["fields"], "projection.", f" ({kind})")
        notes.append(f"* `projection` of the kind `{kind}`: {projection['purpose']}\n")
    for name, prefix in (("distortion", "projection."), ("gates", ""), ("histograms", "")):
        if name in schema:
            rows += _keys(schema[name]["fields"], f"{prefix}{name}.")
        if "purpose" in schema.get(name, {}):
            notes.append(f"* `{prefix}{name}`: {schema[name]['purpose']}\n")
    return (f"QoS: {schema['qos']}.\n\n" + table(["key", "type", "required", "unit", "meaning"], rows)
            + "".join(notes) + "\n" * bool(notes))


def _keys(fields: list[dict], prefix: str = "", where: str = "") -> list[list]:
    """A row for each key of a JSON object."""
    return [[f"`{prefix}{field['name']}`", _type(field),
             ("yes" if field["required"] else "no") + where, field["unit"], field["meaning"]] for field in fields]


def _type(field: dict) -> str:
    return ("number or " if "or_number" in field else "") + (
        f"array of {field['dtype']}" if "dtype" in field else field["type"])


def table(head: list[str], rows: list[list]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(str(cell).replace('|', PIPE) for cell in line)} |\n" for line in lines) + "\n"
