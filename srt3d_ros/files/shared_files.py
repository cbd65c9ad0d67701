"""Find files that come with the package beside its code: config/, msg_schemas/, …"""

import os
from pathlib import Path


def find(name: str) -> Path | None:
    """Path of a file such as `config/srt3d.yaml` in the source tree or in share/srt3d_ros, or None."""
    for parent in Path(__file__).resolve().parents:
        for path in (parent / name, parent / "share" / "srt3d_ros" / name):
            if os.path.isfile(path):        # False for a name that is too long, unlike Path.is_file
                return path
    return None
