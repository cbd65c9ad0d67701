"""A node for tests, which wait for its reports and take their time: reports every 0.1 s, and a long wait for motion."""

import sys

from srt3d_ros.cli import node

if __name__ == "__main__":
    node.exit_at_once_on_signals()
    from srt3d_ros.core.sketching import stream
    from srt3d_ros.nodes import diagnostics

    diagnostics.PERIOD_S, stream.MOTION_S = 0.1, 30.0
    sys.exit(node.start(sys.argv[1], sys.argv[2:]))
