"""Check whether an .rrd file is whole, and repair one that was cut off into a copy.

An .rrd file is a header of 12 bytes (RRF2, version of rerun, compression and encoding) and messages, each after 16
bytes with its kind and length. The footer, an index of the messages, is written when the file is closed. A killed
recorder or a full disk leaves a file without footer that may end within a message.
"""

import os
import struct
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import appearing_whole

_HEADER_BYTES = 12                              # mark, 3 of the version, options
_MESSAGE = struct.Struct("<QQ")                 # kind, bytes that follow
_MARK, _ANY_MARK = b"RRF2", b"RRF"
_END = struct.Struct("<4s4sI")                  # of the footer: mark, FOOT, number of indices
_FOOTER, *_CONTENTS = range(4)                  # kinds: the footer; store, chunk, blueprint activation
_NO_MESSAGE = "an .rrd file of which more than its header was written"
_NO_ROOM = "room on the disk for a repaired copy beside it"


@dataclass(frozen=True)
class FileState:
    """How much of a file is usable."""

    path: Path
    is_finished: bool       # the footer is there
    lost_bytes: int         # of a last message that was not written completely


def examine(path) -> FileState:
    """Check the header, the lengths of the messages and the footer of a file.

    Raises:
        InvalidInput: the file does not exist, is empty or no .rrd file, a newer rerun wrote it, or it has no message.
    """
    path = Path(path)
    require(path.is_file(), "recording", str(path), "an .rrd file that exists")
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        require(size > 0, "recording", str(path), "an .rrd file that is not empty")
        file.seek(0)
        _check_header(file.read(_HEADER_BYTES), path)
        if _ends_with_footer(file, size):
            return FileState(path, True, 0)
        whole = _whole_bytes(file, size)
    require(whole > _HEADER_BYTES, "recording", str(path), _NO_MESSAGE)
    return FileState(path, False, size - whole)


def repair(state: FileState) -> Path:
    """Copy the messages of an unfinished file that can be read to NAME_repaired.rrd, with a footer; returns its path.

    An earlier copy is replaced; the original is not changed.

    Raises:
        InvalidInput: the copy cannot be written, or no message can be read.
    """
    path = state.path
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
                require(_ends_with_footer(copy, part.stat().st_size), "recording", str(path), _NO_ROOM)
    except OSError as e:
        raise InvalidInput("recording", str(path), f"{_NO_ROOM} ({e.strerror or e})") from None
    return target


def _check_header(header: bytes, path: Path) -> None:
    require(header.startswith(_ANY_MARK), "recording", str(path), "an .rrd file, as the recorder writes it")
    require(len(header) == _HEADER_BYTES, "recording", str(path), _NO_MESSAGE)
    installed, of = version("rerun-sdk"), list(header[4:7])
    readable = header.startswith(_MARK) and of[:2] <= [int(part) for part in installed.split(".")[:2]]
    require(readable, "recording", str(path), f"a file of rerun 0.23 to {installed}; it is of "
            f"{'.'.join(map(str, of))}: pip install -U rerun-sdk, or `rerun rrd migrate`")


def _ends_with_footer(file, size: int) -> bool:
    if size < _HEADER_BYTES + _END.size:
        return False
    file.seek(size - _END.size)
    return _END.unpack(file.read(_END.size))[:2] == (_MARK, b"FOOT")


def _whole_bytes(file, size: int) -> int:
    """Where the last whole message before the footer ends."""
    end = _HEADER_BYTES
    while end + _MESSAGE.size <= size:
        file.seek(end)
        kind, length = _MESSAGE.unpack(file.read(_MESSAGE.size))
        if kind not in _CONTENTS or end + _MESSAGE.size + length > size:
            break
        end += _MESSAGE.size + length
    return end
