"""Starts, tunes and ends the processes of the nodes."""
