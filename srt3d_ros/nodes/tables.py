"""The parameter tables of all nodes, and the configuration file made from them.

    python -m srt3d_ros.nodes.tables > config/srt3d.yaml
"""

from srt3d_ros.nodes import player, reconstructor, recorder, sketcher
from srt3d_ros.nodes.parameters import as_yaml

TABLES = {"player": player.PARAMETERS, "sketcher": sketcher.PARAMETERS, "reconstructor": reconstructor.PARAMETERS,
          "recorder": recorder.PARAMETERS}

HEADING = """\
# Every parameter of the nodes with its default: a start for your own file. Made by python -m srt3d_ros.nodes.tables.
# "live" parameters may be changed while the node runs, with ros2 param set.
#   ros2 run srt3d_ros sketcher --ros-args --params-file srt3d.yaml

"""


def config_yaml() -> str:
    """The text of config/srt3d.yaml."""
    return HEADING + as_yaml(TABLES)


if __name__ == "__main__":
    print(config_yaml(), end="")
