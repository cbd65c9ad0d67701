"""The ROS 2 nodes. Beside them, only `srt3d health` imports rclpy."""

from importlib import import_module

from srt3d_ros.processes.node_command import NODES


def all_specs() -> dict:
    """The NodeSpec of every node, by name; ModuleNotFoundError if a node's packages are missing."""
    return {name: import_module(f"srt3d_ros.nodes.{name}").SPEC for name in NODES}
