"""Check whether an .rrd file is whole, and repair one that was cut off into a copy.

An .rrd file is a header of 12 bytes (RRF2, version of rerun, compression and encoding), messages, and a footer, an
index of the messages, which is written when the file is closed. A killed recorder or a full disk leaves a file without
footer that may end within a message.
"""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from rerun.chunk import RrdReader

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import appearing_whole

_HEADER_BYTES = 12
_MARK, _ANY_MARK = b"RRF2", b"RRF"
_FOOTER_BYTES, _FOOTER_MARK = 12, b"RRF2FOOT"   # of the footer's end: the mark, and the number of indices
_NO_ROOM = "room on the disk for a repaired copy beside it"


def examine(path) -> bool:
    """Check the header of a file; True if it was finished: it has its footer.

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
        return _ends_with_footer(file)


def repair(path) -> Path:
    """Copy the messages of an unfinished file that can be read to NAME_repaired.rrd, with a footer; returns its path.

    An earlier copy is replaced; the original is not changed.

    Raises:
        InvalidInput: the copy cannot be written, or no message can be read.
    """
    path = Path(path)
    target = path.with_name(f"{path.stem}_repaired{path.suffix}")
    require(os.access(path.parent, os.W_OK), "recording", str(path),
            "a finished file, or a folder that can be written for a repaired copy")
    try:
        with appearing_whole(target) as part:
            # `filter` copies chunk by chunk; `merge` and `optimize` hold the whole recording in memory.
            command = [sys.executable, "-m", "rerun_cli", "rrd", "filter", "--continue-on-error", "-o", part, path]
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                  env=os.environ | {"NO_COLOR": "1", "RUST_LOG": "error"})
            error = done.stderr.decode(errors="replace").strip().split("\n")[-1] or "no output of rerun"
            require(done.returncode == 0, "recording", str(path), f"chunks that can be read ({error})")
            with open(part, "rb") as copy:      # on a full disk rerun exits with 0
                require(_ends_with_footer(copy), "recording", str(path), f"chunks that can be read, and {_NO_ROOM}")
            require(bool(RrdReader(part).recordings()), "recording", str(path), "an .rrd file with a whole chunk")
    except OSError as e:
        raise InvalidInput("recording", str(path), f"{_NO_ROOM} ({e.strerror or e})") from None
    return target


def _ends_with_footer(file) -> bool:
    file.seek(-min(_FOOTER_BYTES, file.seek(0, os.SEEK_END)), os.SEEK_END)
    return file.read().startswith(_FOOTER_MARK)
