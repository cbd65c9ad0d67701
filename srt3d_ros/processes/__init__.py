"""Starts, tunes, describes and ends the processes of the nodes."""
