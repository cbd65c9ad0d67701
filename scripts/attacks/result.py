"""What an attack leaves: its figures, with the command that made them, when, and on what machine."""

import json
import sys
import time
from pathlib import Path

from process import REPOSITORY

from srt3d_ros.evaluation.machine import machine


def write_result(path: Path, facts: dict) -> dict:
    """Write the figures of an attack, its seed among them, as JSON; all that was written."""
    told = {"command": " ".join([Path(sys.executable).name, str(Path(sys.argv[0]).resolve().relative_to(REPOSITORY)),
                                 *sys.argv[1:]]),
            "date": time.strftime("%Y-%m-%dT%H:%MZ", time.gmtime()), "machine": machine()} | facts
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(told, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return told
