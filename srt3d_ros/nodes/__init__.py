"""The ROS 2 nodes: player, sketcher, reconstructor, recorder. rclpy is imported here and nowhere else.

Importing this package prepares the process for big messages, because that has to happen before rclpy is imported.
"""

from srt3d_ros.nodes import transport

transport.prepare_process()
