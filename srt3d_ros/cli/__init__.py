"""The `srt3d` command: one module for each sub-command."""
