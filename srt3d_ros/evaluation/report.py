"""The README.md of an evaluation, with its figures."""

from collections.abc import Sequence
from pathlib import Path

from srt3d_ros import __version__
from srt3d_ros.evaluation.results import markdown
from srt3d_ros.evaluation.run import Outcome
from srt3d_ros.versions import PACKAGES, machine

NO_FIGURES = "no figures without matplotlib: pip install 'srt3d_ros[review]'"


def write(folder: Path, rows: Sequence[dict], shown: Sequence[Outcome], notes: list[str], command: str) -> None:
    """Draw the figures and write README.md.

    Args:
        rows: averaged.
        shown: whose clouds are drawn.
        notes: lines for the user; gets one if nothing can be drawn.
        command: the command line of this evaluation.
    """
    try:
        from srt3d_ros.evaluation.figures import draw
    except ModuleNotFoundError:
        drawn = []
        notes.append(NO_FIGURES)
    else:
        drawn = draw(folder, rows, shown)
    facts = machine()
    lines = ["# Evaluation", "", f"    {command}", "",
             f"srt3d_ros {__version__}, {facts['date']}, {facts['cpus']} CPUs of {facts['machine']}; Python "
             f"{facts['python']}, {', '.join(f'{name} {facts[name]}' for name in PACKAGES if name in facts)}.", ""]
    lines += [f"- {note}" for note in notes] + [""] * bool(notes)
    lines += [markdown(rows), "", "True detections of several surfaces: of each, a + between. `results.csv` has "
              "more columns.", ""]
    lines += [f"![{path.stem}]({path.name})\n" for path in drawn]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")
