"""README.md and figures of an evaluation."""

from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.evaluation import table
from srt3d_ros.evaluation.machine import machine


def write(folder: Path, rows: list[dict], shown: list, notes: list[str], command: str) -> None:
    """Draw what there is to draw and say how it came about.

    Args:
        rows: averaged rows of all jobs.
        shown: jobs whose clouds were saved.
        notes: what was left out.
        command: that was typed.
    """
    facts = machine()
    lines = ["# Evaluation", "", f"    {command}", "",
             f"srt3d_ros {__version__}, {facts['date']}, {facts['cpus']} CPUs of {facts['machine']}; Python "
             f"{facts['python']}, NumPy {facts['numpy']}, torch {facts['torch']}, numba {facts['numba']}.", ""]
    lines += [f"- {note}" for note in notes] + [""] * bool(notes)
    lines += [table.markdown(rows), ""]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")
