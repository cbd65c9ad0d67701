"""The folder of a batch: a file for each frame, and a note of what they are made of and how, for those who go on."""

import json
from pathlib import Path
from typing import Any

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import json_text
from srt3d_ros.new_files import appearing_whole
from srt3d_ros.recording import cloud_files

NOTE = "batch.json"
PREFIX = "frame_"


class Folder:
    """A folder that is new or empty, or that was begun in the same way.

    Args:
        path: made if it is not there.
        suffix: of the files, such as ".npz".
        made: of what and how they are made: values that JSON can hold, by name.

    Raises:
        InvalidInput: it cannot be written, has other files, or was begun in another way.
    """

    def __init__(self, path: Path, suffix: str, made: dict[str, Any]):
        self.path, self._suffix = path, suffix
        require(not path.exists() or path.is_dir(), "output", str(path), "a folder")
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InvalidInput("output", str(path), f"a folder that can be made ({error.strerror})") from None
        cloud_files.check(self.file(0))
        note, made = path / NOTE, json.loads(json.dumps(made))
        others = [file.name for file in path.iterdir() if file != note]
        require(note.is_file() or not others, "output", str(path), "a new or empty folder, or one of the same command")
        if any(name.startswith(PREFIX) for name in others):
            self._compare(json_text.parse(note.read_text(), NOTE), made)
        else:           # whatever failed before
            with appearing_whole(note) as part:
                part.write_text(json.dumps(made, indent=1) + "\n")

    def file(self, number: int) -> Path:
        """That of a frame; it is there when the frame is done."""
        return self.path / f"{PREFIX}{number:06d}{self._suffix}"

    def sweep(self) -> None:
        """Remove what processes that were killed had half written."""
        for part in self.path.glob(f".{PREFIX}*.part{self._suffix}"):
            part.unlink(missing_ok=True)

    def _compare(self, before: dict[str, Any], now: dict[str, Any]) -> None:
        for name in before | now:
            was, wanted = before.get(name), now.get(name)
            require(was == wanted, "output", str(self.path),
                    f"another folder: this one was begun with {name} {_shown(was)}, not {_shown(wanted)}")


def _shown(value: Any) -> str:
    return "not given" if value is None else value if isinstance(value, str) else json.dumps(value)
