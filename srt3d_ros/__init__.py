"""Sketched real-time 3D reconstruction from single-photon lidar, as ROS 2 nodes and a library."""

__version__ = "0.1.0"
