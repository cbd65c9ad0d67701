"""The files of a recording: their names, and when the next one begins."""

import re
from dataclasses import dataclass
from pathlib import Path

from srt3d_ros.new_files import next_free

_MB = 1_000_000


@dataclass(frozen=True)
class Split:
    """When a recording goes on in the next file: once a file is as large (10⁶ bytes) or as old; 0 = never."""

    size_mb: float = 0.0
    period_s: float = 0.0

    def __bool__(self) -> bool:
        return self.size_mb > 0 or self.period_s > 0

    def due(self, size: int, age_s: float) -> bool:
        """True if the next file must follow one of `size` bytes and this age."""
        return 0 < self.size_mb * _MB <= size or 0 < self.period_s <= age_s


class PartNames:
    """The paths of a recording's files.

    Args:
        path: as given by the user. Without `numbered` the first file has this path and replaces what is there; the
            next ones are NAME_2.rrd, NAME_3.rrd, … and skip existing files. With `numbered` they are NAME_001.rrd,
            NAME_002.rrd, … after the highest existing number.
        numbered: whether there will be several.
    """

    def __init__(self, path: Path, numbered: bool):
        self._path, self._numbered = path, numbered
        self._begun = 0         # the number of the last file

    def next(self) -> Path:
        """The path of the next file."""
        if self._numbered:
            self._begun = max(self._begun, self._last_number()) + 1     # files that were moved away keep their numbers
            return self._path.with_stem(f"{self._path.stem}_{self._begun:03}")
        self._begun += 1
        return self._path if self._begun == 1 else next_free(self._path)

    def _last_number(self) -> int:
        pattern = re.compile(rf"{re.escape(self._path.stem)}_(\d{{3,}})$")
        found = (pattern.match(path.stem) for path in self._path.parent.glob(f"*{self._path.suffix}"))
        return max((int(match[1]) for match in found if match), default=0)
