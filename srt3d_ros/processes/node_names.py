"""The nodes of this package by name, for who must know them without importing ROS 2."""

PLAYER = "player"
NODES = ("sketcher", "reconstructor", "recorder", PLAYER)
FRAMES_LOST = 3     # a player's exit code: not all that it sent became clouds
