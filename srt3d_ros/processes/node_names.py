"""The names of the nodes, without importing ROS 2."""

PLAYER = "player"
NODES = ("sketcher", "reconstructor", "recorder", PLAYER)
FRAMES_LOST = 3     # exit code of a player if some of its frames did not become clouds
