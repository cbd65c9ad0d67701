"""The default method: from a sketch to a cloud."""
