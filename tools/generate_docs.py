"""Write what is made from others: docs, default parameters and the SROS 2 policy from specs and schemas, the Fast DDS
profiles of Kilted from those of Jazzy.

    python -m tools.generate_docs           # in the source tree, after every change of a spec or a schema
"""

from pathlib import Path

from srt3d_ros.nodes.specs import SPECS
from tools.node_reference import as_yaml, topics_table
from tools.policy import policy
from tools.schema_tables import filled, readme

ROOT = Path(__file__).resolve().parents[1]
HEADING = """\
# Every parameter of the nodes with its default: a start for your own file. Made by python -m tools.generate_docs.
# "live" parameters may be changed while the node runs, with ros2 param set.
#   ros2 run srt3d_ros sketcher --ros-args --params-file srt3d.yaml

"""


def kilted(profile: str) -> str:
    """A profile of Fast DDS 2 as Fast DDS 3 wants it, where one element has another name."""
    return profile.replace("FASTRTPS_", "FASTDDS_").replace("heartbeatPeriod>", "heartbeat_period>")


def generated() -> dict[str, str]:
    """The text of every generated file, by its path in the source tree."""
    specs = SPECS.values()
    profiles = {f"config/kilted/{path.name}": kilted(path.read_text(encoding="utf-8"))
                for path in sorted(ROOT.glob("config/fastdds_*.xml"))}
    return {"config/srt3d.yaml": HEADING + as_yaml({spec.name: spec.table for spec in specs}),
            "config/srt3d.policy.xml": policy(specs),
            "docs/nodes.md": filled(ROOT / "docs/nodes.md", lambda _: topics_table(specs)),
            "msg_schemas/README.md": readme(),
            **profiles}


if __name__ == "__main__":
    for path, text in generated().items():
        Path(path).write_text(text, encoding="utf-8")
        print(path)
