"""What an attack leaves: its figures, with the command that made them, when, and on what machine."""

import json
import re
import sys
import time
from pathlib import Path

from process import REPOSITORY

from srt3d_ros.evaluation.machine import machine


def as_text(facts: dict) -> str:
    """JSON to read and compare: a line for each fact, and for a whole list of numbers; no folder of this machine."""
    text = json.dumps(facts, indent=1, ensure_ascii=False)
    text = re.sub(r"\[[^][{}]*\]", lambda values: re.sub(r"\n\s*", " ", values[0]), text)
    return text.replace(f"{REPOSITORY}/", "")


def write_result(path: Path, facts: dict) -> dict:
    """Write the figures of an attack, its seed among them, as JSON; all that was written."""
    told = {"command": " ".join([Path(sys.executable).name, str(Path(sys.argv[0]).resolve().relative_to(REPOSITORY)),
                                 *sys.argv[1:]]),
            "date": time.strftime("%Y-%m-%dT%H:%MZ", time.gmtime()), "machine": machine()} | facts
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(as_text(told) + "\n", encoding="utf-8")
    return told
