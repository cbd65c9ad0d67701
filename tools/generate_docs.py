"""Write what is made from the specs of the nodes: config/srt3d.yaml, config/srt3d.policy.xml, docs/nodes/*.md and
docs/images/graph.svg.

    python -m tools.generate_docs           # in the source tree, after every change of a spec
"""

from pathlib import Path

from srt3d_ros.nodes.specs import SPECS
from tools.graph import draw
from tools.node_reference import as_yaml, page
from tools.policy import policy

HEADING = """\
# Every parameter of the nodes with its default: a start for your own file. Made by python -m tools.generate_docs.
# "live" parameters may be changed while the node runs, with ros2 param set.
#   ros2 run srt3d_ros sketcher --ros-args --params-file srt3d.yaml

"""


def generated() -> dict[str, str]:
    """The text of every generated file, by its path in the source tree."""
    parameters = as_yaml({name: spec.table for name, spec in SPECS.items()})
    return {"config/srt3d.yaml": HEADING + parameters,
            **{f"docs/nodes/{name}.md": page(spec) for name, spec in SPECS.items()},
            "config/srt3d.policy.xml": policy(SPECS.values()),
            "docs/images/graph.svg": draw(SPECS.values())}


if __name__ == "__main__":
    for path, text in generated().items():
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_text(text)
        print(path)
