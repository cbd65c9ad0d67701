"""Make the tables of docs/messages.md from the schemas (tools/generate_docs.py writes them)."""

import json
import re
from collections.abc import Callable
from pathlib import Path

SCHEMAS = Path(__file__).resolve().parents[1] / "msg_schemas"
MARKED = re.compile(r"(<!-- tables of (\w+)(?:\.json)? -->\n).*?(<!-- end -->)", re.DOTALL)
PIPE = "\\|"              # a | in a cell of a Markdown table


def filled(page: Path, make: Callable[[str], str]) -> str:
    """The text of a page, with make(name) between the marks of each name."""
    return MARKED.sub(lambda found: found[1] + make(found[2]) + found[3], page.read_text(encoding="utf-8"))


def tables(name: str) -> str:
    """The description and tables of one schema."""
    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    layout = schema.get("x-layout", {})
    version = schema["x-version"] if layout else schema["properties"]["schema_version"]["const"]
    made = (cloud_tables(layout) if "layouts" in layout else image_tables(name, layout) if layout
            else json_tables(schema))
    return f"{schema['description']}\n`{schema['x-type']}`, schema version {version}; {made}"


def cloud_tables(topic: dict) -> str:
    """The layouts of a PointCloud2 topic and one table of their bytes; a field that layouts share is one row."""
    layouts = topic["layouts"]
    purposes = "".join(f"* **{name}**, `point_step` {layout['point_step']}: {layout['purpose']}\n"
                       for name, layout in layouts.items())
    shared: dict[tuple, list[str]] = {}
    for name, layout in layouts.items():
        for field in layout["fields"]:
            row = (field["offset"], f"`{field['name']}`", field["datatype"], field["count"], field["unit"],
                   field["meaning"])
            shared.setdefault(row, []).append(name)
    rows = [[", ".join(names), *row] for row, names in shared.items()]
    return f"`height` {topic['height']}; `width` {topic['width']}.\n\n{purposes}\n" + table(
        ["layout", "byte", "field", "datatype", "count", "unit", "meaning"], rows)


def image_tables(name: str, topic: dict) -> str:
    """The shape, encodings and pixels of an Image topic."""
    topics = topic.get("topics", {name: topic["pixel"]})
    encodings = " or ".join(f"`{encoding}` ({kind})" for encoding, kind in topic["encodings"].items())
    return (f"`height` {topic['height']}; `width` {topic['width']}; `encoding` {encodings}.\n\n"
            + table(["topic", "unit", "meaning of a pixel"],
                    [[f"`{name}`", topic["unit"], topic["meaning"]] for name, topic in topics.items()]))


def json_tables(schema: dict) -> str:
    """The keys of a JSON topic and of its objects, then what these objects are."""
    rows, notes = _keys("", schema), ""
    for kind, part in schema["$defs"].items():
        if "title" in part:
            rows += _keys(f"{part['title']}.", part)
            of_kind = "" if part["title"].endswith(kind) else f" of the kind `{kind}`"
            notes += f"* `{part['title']}`{of_kind}: {part['description']}\n"
    return f"QoS: {schema['x-qos']}.\n\n{table(['key', 'type', 'required', 'unit', 'meaning'], rows)}{notes}\n"


def _keys(prefix: str, schema: dict) -> list[list[str]]:
    """A row for each key of a JSON object."""
    return [[f"`{prefix}{name}`", _type(part), "yes" if name in schema["required"] else "no", part.get("x-unit", ""),
             part["description"]] for name, part in schema["properties"].items()]


def _type(part: dict) -> str:
    if "x-dtype" in part:
        return f"array of {part['x-dtype']}"
    return part.get("type", "object" if "$ref" in part else "string")


def table(head: list[str], rows: list[list]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(str(cell).replace('|', PIPE) for cell in line)} |\n" for line in lines) + "\n"
