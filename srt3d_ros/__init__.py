"""Sketched real-time 3D reconstruction from single-photon lidar, as ROS 2 nodes and a library."""

import os

# Threads that wait for others must sleep: while they spin, as those of OpenMP do by default, they hold the cores that
# the other nodes need. Four times faster on a busy machine, no slower on an idle one. Read when torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

__version__ = "0.1.0"
