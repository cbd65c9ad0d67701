"""Files: arrays and JSON that nobody vouches for, new files, and those that come with the package."""

import os
from pathlib import Path


def shared_file(name: str) -> Path | None:
    """Path of a file such as `config/srt3d.yaml` in the source tree or in share/srt3d_ros, or None."""
    for parent in Path(__file__).resolve().parents:
        for path in (parent / name, parent / "share" / "srt3d_ros" / name):
            if os.path.isfile(path):        # False for a name that is too long, unlike Path.is_file
                return path
    return None
