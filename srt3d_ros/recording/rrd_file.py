"""Check an .rrd file, and copy what can be read of one that was cut off.

An .rrd file is a header of 12 bytes (RRF2, version of rerun, compression and encoding), messages, and a footer, an
index of the messages, which is written when the file is closed. A killed recorder leaves a file without footer that may
end within a message.
"""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from srt3d_ros.errors import require

_HEADER_BYTES = 12
_MARK, _ANY_MARK = b"RRF2", b"RRF"
_FOOTER_BYTES, _FOOTER_MARK = 12, b"RRF2FOOT"   # of the footer's end: the mark, and the number of indices


def is_finished(path) -> bool:
    """Check the header of a file; True if it was closed: it has its footer.

    Raises:
        InvalidInput: the file does not exist, is empty or no .rrd file, a newer rerun wrote it, or it has no message.
    """
    path = Path(path)
    require(path.is_file(), "recording", str(path), "an .rrd file that exists")
    with open(path, "rb") as file:
        header, size = file.read(_HEADER_BYTES), file.seek(0, os.SEEK_END)
        require(size > 0, "recording", str(path), "an .rrd file that is not empty")
        require(header.startswith(_ANY_MARK), "recording", str(path), "an .rrd file, as the recorder writes it")
        installed, of = version("rerun-sdk"), list(header[4:7])
        readable = header.startswith(_MARK) and of[:2] <= [int(part) for part in installed.split(".")[:2]]
        require(readable, "recording", str(path), f"a file of rerun 0.23 to {installed}; it is of "
                f"{'.'.join(map(str, of))}: pip install -U rerun-sdk, or `rerun rrd migrate`")
        require(size > _HEADER_BYTES, "recording", str(path), "an .rrd file of which more than its header was written")
        file.seek(-_FOOTER_BYTES, os.SEEK_END)
        return file.read().startswith(_FOOTER_MARK)


def copy_readable(path: Path, copy: Path) -> None:
    """Copy the messages of an unfinished file that can be read, with a footer.

    Raises:
        InvalidInput: no message can be read, or the copy cannot be written.
    """
    # `filter` copies chunk by chunk; `merge` and `optimize` hold the whole recording in memory.
    command = [sys.executable, "-m", "rerun_cli", "rrd", "filter", "--continue-on-error", "-o", copy, path]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True)
    whole = done.returncode == 0 and copy.is_file() and is_finished(copy)      # on a full disk rerun exits with 0
    require(whole, "recording", str(path), f"chunks that can be read, and room for their copy in {copy.parent}")
