"""Reads and writes files: arrays that may be damaged, JSON, new files that appear whole, files of the package."""
