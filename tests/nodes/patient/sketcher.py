"""The sketcher, which waits longer for motion: a busy machine may take seconds between two steps of a test."""

import sys

from srt3d_ros.core.sketching import stream
from srt3d_ros.nodes import sketcher

stream.MOTION_S = 30.0
sys.exit(sketcher.main())
