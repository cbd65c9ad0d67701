"""The ROS 2 nodes: player, sketcher, reconstructor, recorder, bag_recorder. rclpy is imported here and nowhere else."""
