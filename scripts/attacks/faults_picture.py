"""How soon clouds were back, a dot a round, a line a fault."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

DOT, FAILED, BOUND = "#0072b2", "#d55e00", "#555555"        # any colour vision (Okabe and Ito, 2008)
BACK_S = 3.0
SPREAD = 0.28               # of the dots across their line


def draw(rounds: Sequence, path: Path) -> None:
    """Save a strip plot of `recovery_s` of rounds with `fault` and `problems`."""
    timed = [played for played in rounds if played.recovery_s is not None]
    names = sorted({played.fault for played in timed},
                   key=lambda name: np.median([played.recovery_s for played in timed if played.fault == name]))
    figure = Figure(figsize=(8, 0.8 + 0.3 * len(names)), dpi=100, layout="constrained")
    panel, random = figure.subplots(), np.random.default_rng(0)
    for colour, failed in ((DOT, False), (FAILED, True)):
        shown = [played for played in timed if bool(played.problems) == failed]
        panel.plot([played.recovery_s for played in shown],
                   [names.index(played.fault) + random.uniform(-SPREAD, SPREAD) for played in shown],
                   ".", color=colour, markersize=6, label="failed" if failed else "passed")
    panel.axvline(BACK_S, color=BOUND, linestyle="--", linewidth=1, label="has to be back")
    panel.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    panel.set(xlabel="from the end of the fault to the first right cloud, s", xlim=(0, None),
              title=f"{len(rounds)} rounds, {sum(bool(played.problems) for played in rounds)} failed")
    panel.grid(axis="x", color="#d9dce0", linewidth=0.6)
    panel.legend(frameon=False, fontsize=9, loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
