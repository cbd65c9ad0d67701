"""Equal bytes: the depth error of a frame against the bytes that it travels in, for sketches, histograms and photons.

The error is the mean over all reference surfaces of |t − t̂|, and of the tolerance τ for those that are missed:
TD · DAE + (1 − TD) · τ, so that nothing wins by showing few points.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from srt3d_ros.benchmark.plan import Plan
from srt3d_ros.benchmark.representations import OURS, POOLED, REPRESENTATIONS, Frame
from srt3d_ros.benchmark.timing import Progress
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.evaluation.cases import Case, Observation, of_files, simulated
from srt3d_ros.evaluation.results import aligned
from srt3d_ros.evaluation.run import judge

TITLE = "Depth error in equal bytes"
BUDGETS = (10, 20, 40, 80)      # bytes a pixel
LEVEL = 1.02                    # errors within 2 % are level: another draw of the photons changes them by as much


def measure(plan: Plan, bar: Progress) -> Iterator[dict]:
    """A line for each size of each representation that the largest budget holds, and each reconstruction of it."""
    lights = [case for sbr, ppp in plan.lights for case in simulated("bust", [sbr], [ppp], side=plan.side)]
    for case in [*lights, *of_files(list(plan.photons), plan.tolerance)]:
        bar.show(f"{case.title}: photons")
        for text in case.notes:
            bar.note(text)
        observation = case.observe()
        if observation.depth_bins is None:
            bar.note(f"{case.title}: left out: it has no reference depths")
            continue
        frame = Frame(observation.frame, case.sensor, case.surfaces, plan.device)
        for name, pack in REPRESENTATIONS.items():
            bar.show(f"{case.title}: {name}")
            for number, packed in enumerate(pack(frame, plan.every_size)):
                bytes_per_pixel = packed.bytes / case.sensor.pixels
                if number > 0 and bytes_per_pixel > max(BUDGETS):
                    break
                for how, reconstruct in packed.clouds:
                    yield {"case": case.title, "representation": name, "size": packed.size, "reconstruction": how,
                           "bytes_per_pixel": float(f"{bytes_per_pixel:.4g}"), "device": plan.device,
                           "photons_per_pixel": float(f"{observation.frame.photons / case.sensor.pixels:.4g}"),
                           **_errors(reconstruct(), case, observation)}


def _errors(cloud: PointCloud, case: Case, observation: Observation) -> dict:
    found = judge(cloud, case, observation)
    detected, within = found["true_detections_percent"] / 100, float(case.tolerance_bins)
    error = (1 - detected) * within + (detected * found["dae_bins"] if detected else 0)
    names = ("true_detections_percent", "false_detections_percent", "dae_bins")
    return {"error_bins": float(f"{error:.4g}"), "tolerance_bins": round(within, 3), **{
        name: float(f"{found[name]:.5g}") if np.isfinite(found[name]) else None for name in names}}


def best(lines: Sequence[dict]) -> dict[tuple[str, str, str, int], dict]:
    """By case, representation, reconstruction and budget: the line of the least error that the budget holds."""
    found: dict[tuple[str, str, str, int], dict] = {}
    for line, budget in product(lines, BUDGETS):
        key = line["case"], line["representation"], line["reconstruction"], budget
        if line["bytes_per_pixel"] <= budget and line["error_bins"] < found.get(key, {}).get("error_bins", np.inf):
            found[key] = line
    return found


def table(lines: Sequence[dict]) -> str:
    """For people: each case, the mean over all of them, then where ours leads and where not."""
    found = best(lines)
    cases, rows = (list(dict.fromkeys(key)) for key in (
        (line["case"] for line in lines), ((line["representation"], line["reconstruction"]) for line in lines)))
    heading = ["representation", "reconstruction", *(f"{budget} bytes" for budget in BUDGETS)]
    text = []
    for case in cases:
        text += [f"{case}: error, bins; TD % / FD % / DAE, bins", "", aligned([heading, *(
            [*row, *(_cell(found.get((case, *row, budget))) for budget in BUDGETS)] for row in rows)]), ""]
    text += ["Error over that of the coded sketch (pooled), geometric mean over the cases that the bytes hold", "",
             aligned([heading, *([*row, *(_ratio(found, cases, row, budget) for budget in BUDGETS)] for row in rows)]),
             "", *(_standing(found, cases, budget) for budget in BUDGETS)]
    return "\n".join(text)


def _cell(line: dict | None) -> str:
    if line is None:
        return "–"
    dae = "–" if line["dae_bins"] is None else f"{line['dae_bins']:.3g}"
    return f"{line['error_bins']:.3g}; {line['true_detections_percent']:.1f} / " \
           f"{line['false_detections_percent']:.1f} / {dae}"


def _ratio(found: dict, cases: list[str], row: tuple[str, str], budget: int) -> str:
    pairs = [(found.get((case, *row, budget)), found.get((case, OURS, POOLED, budget))) for case in cases]
    ratios = [theirs["error_bins"] / ours["error_bins"] for theirs, ours in pairs if theirs and ours]
    if not ratios:
        return "–"
    some = "" if len(ratios) == len(cases) else f" ({len(ratios)} of {len(cases)})"
    return f"{np.exp(np.mean(np.log(ratios))):.2f}{some}"


def _standing(found: dict, cases: list[str], budget: int) -> str:
    """In how many cases no other representation has less error than ours, by its best reconstruction; and the rest."""
    behind = []
    for case in cases:
        lines = sorted((line for (of, *_, limit), line in found.items() if (of, limit) == (case, budget)),
                       key=lambda line: line["error_bins"])
        ours = next((line["error_bins"] for line in lines if line["representation"] == OURS), None)
        least = next((line for line in lines if line["representation"] != OURS), None)
        if least and (ours is None or ours > LEVEL * least["error_bins"]):
            own = "nothing" if ours is None else f"{ours:.3g}"
            behind.append(f"{case} ({least['representation']} {least['error_bins']:.3g}, ours {own})")
    leads = f"the coded sketch leads or is level within {100 * LEVEL - 100:.0f} % in {len(cases) - len(behind)} of " \
            f"{len(cases)} cases"
    return f"{budget} bytes a pixel: {leads}{'; behind in ' if behind else ''}{', '.join(behind)}."


def draw(path: Path, lines: Sequence[dict]) -> None:
    """Error against bytes, a panel for each case."""
    from srt3d_ros.pictures.curves import draw_bytes
    draw_bytes(path, lines, tuple(REPRESENTATIONS), BUDGETS)
