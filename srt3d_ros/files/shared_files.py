"""The files that come with the package beside its code: config/, msg_schemas/, …, in the source tree or installed."""

import os
from pathlib import Path


def find(name: str) -> Path | None:
    """The path of a shared file such as `config/srt3d.yaml`, of the source tree or of share/srt3d_ros, or None."""
    for parent in Path(__file__).resolve().parents:
        for path in (parent / name, parent / "share" / "srt3d_ros" / name):
            if os.path.isfile(path):        # also for a name that is too long to be one
                return path
    return None
