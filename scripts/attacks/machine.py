"""Disks of this process's own: small, to be filled, to be made read-only. Nothing of it is seen or left outside.

The process and all that it starts live in a mount namespace of their own: Linux, and root or user namespaces.
"""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

ALONE = "SRT3D_ATTACK_MOUNTS"       # set inside the namespace
LEFT_BYTES = 0


def have_own_mounts() -> str:
    """Go on in a mount namespace, where that can be; otherwise why not, in words."""
    if os.environ.get(ALONE):
        return ""
    ways = [["unshare", "--mount", "--propagation", "private"],
            ["unshare", "--user", "--map-root-user", "--mount", "--propagation", "private"]]
    for way in ways:
        with contextlib.suppress(OSError):
            tried = subprocess.run([*way, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, text=True)
            if tried.returncode == 0:
                os.environ[ALONE] = "1"
                os.execvp(way[0], [*way, sys.executable, *sys.argv])
    return "mount namespaces need root, or user namespaces"


class Disk:
    """A file system in memory, at a folder that is there.

    Raises:
        subprocess.CalledProcessError: it cannot be mounted.
    """

    def __init__(self, folder: Path, size_mb: int, mode: str = "0755"):
        self.folder, self._filler = folder, folder / "filler"
        options = f"size={size_mb}m,mode={mode}"
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "attack", folder], check=True)

    @property
    def free_bytes(self) -> int:
        room = os.statvfs(self.folder)
        return room.f_bavail * room.f_frsize

    def fill(self, left_bytes: int = LEFT_BYTES) -> None:
        """Leave no room, or only so much."""
        with open(self._filler, "ab") as file:
            while (size := self.free_bytes - left_bytes) > 0:
                with contextlib.suppress(OSError):      # somebody else took it meanwhile
                    os.posix_fallocate(file.fileno(), file.seek(0, os.SEEK_END), size)

    def empty(self) -> None:
        """Take the filler away."""
        self._filler.unlink(missing_ok=True)

    def read_only(self, so: bool) -> None:
        """Refuse all that writes, or no longer; OSError of mount while a file is open for writing."""
        subprocess.run(["mount", "-o", f"remount,{'ro' if so else 'rw'}", self.folder], check=True)

    def unmount(self) -> None:
        """Give it back, also while somebody looks at it."""
        subprocess.run(["umount", "--lazy", self.folder], check=True)
