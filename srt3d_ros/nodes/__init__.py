"""The ROS 2 nodes; only here rclpy."""

from importlib import import_module

from srt3d_ros.processes.node_names import NODES


def all_specs() -> dict:
    """The NodeSpec of every node by name. Importing them takes what each node needs."""
    return {name: import_module(f"srt3d_ros.nodes.{name}").SPEC for name in NODES}
