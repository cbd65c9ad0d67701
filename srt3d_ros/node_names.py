"""The nodes of this package by name, for who must know them without importing ROS 2."""

PLAYER = "player"
NODES = ("sketcher", "reconstructor", "recorder", PLAYER)
