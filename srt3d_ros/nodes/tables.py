"""The interfaces of all nodes, and what is made from them: config/srt3d.yaml, config/srt3d.policy.xml, docs/nodes/*.md
and the graph as a picture.

    python -m srt3d_ros.nodes.tables        # in the source tree; after every change of a table
"""

from pathlib import Path

from srt3d_ros.nodes import bag_recorder, player, reconstructor, recorder, sketcher
from srt3d_ros.nodes.pages import page
from srt3d_ros.nodes.parameters import as_yaml
from srt3d_ros.nodes.policy import policy
from srt3d_ros.pictures.graph import draw

INTERFACES = {interface.name: interface for interface in (
    sketcher.INTERFACE, reconstructor.INTERFACE, recorder.INTERFACE, bag_recorder.INTERFACE, player.INTERFACE)}

HEADING = """\
# Every parameter of the nodes with its default: a start for your own file. Made by python -m srt3d_ros.nodes.tables.
# "live" parameters may be changed while the node runs, with ros2 param set.
#   ros2 run srt3d_ros sketcher --ros-args --params-file srt3d.yaml

"""


def generated() -> dict[str, str]:
    """The text of every generated file, by its path in the source tree."""
    parameters = as_yaml({name: interface.table for name, interface in INTERFACES.items()})
    return {"config/srt3d.yaml": HEADING + parameters,
            **{f"docs/nodes/{name}.md": page(interface) for name, interface in INTERFACES.items()},
            "config/srt3d.policy.xml": policy(INTERFACES.values()),
            "docs/images/graph.svg": draw(INTERFACES.values())}


if __name__ == "__main__":
    for path, text in generated().items():
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_text(text)
        print(path)
