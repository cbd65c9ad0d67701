"""The result file of a machine: a line of JSON for each measurement, on the disk as soon as it is made."""

import json
import os
import re
from pathlib import Path

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.evaluation.machine import machine

_LEFT_OUT = r"\((r|tm)\)|\b(processor|cpu|\d+-core)\b|@.*"     # of a processor's name


def machine_slug(device: str) -> str:
    """A file name for this machine: its GPU, or its processor and the number of cores that this process may use."""
    facts = machine(device)
    name = facts.get("gpu") or f"{re.sub(_LEFT_OUT, ' ', facts['machine'].lower())} {facts['cpus']} cores"
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


class Results:
    """The lines of this run, and the file that they go to.

    The first line of a part replaces those of an earlier run of it; other parts' lines stay.

    Args:
        path: .jsonl; made if it is not there.

    Raises:
        InvalidInput: what is there is no such file.
    """

    def __init__(self, path: Path):
        self.path = path
        self.lines: dict[str, list[dict]] = {}
        self._earlier = _read(path) if path.exists() else []

    def append(self, part: str, line: dict) -> None:
        """Add a line; when this returns it is on the disk."""
        self.lines.setdefault(part, []).append({"part": part, **line, **machine(line.get("device", "cpu"))})
        kept = [line for line in self._earlier if line["part"] not in self.lines]
        every = [*kept, *(line for lines in self.lines.values() for line in lines)]
        whole = self.path.with_suffix(".part")
        whole.write_text("".join(json.dumps(line, ensure_ascii=False) + "\n" for line in every), encoding="utf-8")
        os.replace(whole, self.path)


def _read(path: Path) -> list[dict]:
    expected = "results of srt3d benchmark, or no such file"
    try:
        lines = [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()]
    except ValueError as error:
        raise InvalidInput(str(path), f"unreadable ({error})", expected) from None
    require(all(isinstance(line, dict) and "part" in line for line in lines), str(path), "another kind of file",
            expected)
    return lines


def megabytes(count: int | None) -> str:
    """Bytes in 10⁶ bytes, or a dash."""
    return "–" if count is None else digits(count / 1e6)


def digits(value: float) -> str:
    """Three digits, or all of those before the point."""
    return f"{value:.3g}" if value < 999.5 else f"{value:.0f}"
