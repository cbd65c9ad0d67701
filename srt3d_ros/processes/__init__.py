"""Starts, tunes and ends processes: the nodes, their transport, and the network that they share."""
