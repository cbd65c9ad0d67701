"""Write tables of docs/, the drawing of the rooms and config/srt3d.yaml from the code and the schemas.

    python -m tools.generate_docs       # in the source tree, after a change of a node's spec, a schema or an import
"""

from pathlib import Path

from srt3d_ros.nodes import all_specs
from tools.node_reference import as_yaml, nodes_tables
from tools.rooms import drawing
from tools.schema_tables import filled, tables
from tools.sensor_schema import photon_file_table, schema_text

ROOT = Path(__file__).resolve().parents[1]
HEADING = """\
# Every parameter of the nodes with its default: a start for your own file. Made by python -m tools.generate_docs.
# "live" parameters may be changed while the node runs, with ros2 param set.
#   ros2 run srt3d_ros sketcher --ros-args --params-file srt3d.yaml

"""


def generated() -> dict[str, str]:
    """The text of every generated file, by its path in the source tree."""
    specs = all_specs().values()
    return {"config/srt3d.yaml": HEADING + as_yaml({spec.name: spec.table for spec in specs}),
            "docs/images/rooms.svg": drawing(),
            "docs/nodes.md": filled(ROOT / "docs/nodes.md", lambda name: nodes_tables(specs)[name]),
            "msg_schemas/sensor.json": schema_text(),
            "docs/messages.md": filled(ROOT / "docs/messages.md", tables),
            "docs/photon-file.md": filled(ROOT / "docs/photon-file.md", photon_file_table)}


if __name__ == "__main__":
    for path, text in generated().items():
        Path(path).write_text(text, encoding="utf-8")
        print(path)
