"""Draw an evaluation's metrics and clouds. Needs matplotlib."""

from collections.abc import Sequence
from pathlib import Path

from srt3d_ros.core.methods import METHODS
from srt3d_ros.evaluation.cases import Case
from srt3d_ros.evaluation.run import Outcome
from srt3d_ros.pictures.curves import draw_metrics
from srt3d_ros.pictures.panels import Panel, Strip, draw_clouds

MOST_STRIPS = 10    # rows in a picture; more are not readable


def draw(folder: Path, rows: Sequence[dict], shown: Sequence[Outcome]) -> None:
    """Draw metrics of averaged rows against photons per pixel for each scene, and the clouds of `shown`.

    There is a picture of clouds for each scene, and one for all files.
    """
    for source in dict.fromkeys(row["source"] for row in rows if row["sbr"]):
        chosen = [row for row in rows if row["source"] == source]
        first = chosen[0]
        title = (f"{source}: {first['rows']} × {first['cols']} pixels, {first['num_bins']} bins of "
                 f"{first['bin_width_mm']:.3g} mm, tolerance {first['tolerance_bins'] * first['bin_width_mm']:.3g} mm")
        draw_metrics(folder / f"metrics_{source}.png", chosen, title, list(METHODS))
    of_picture: dict[str, dict[Case, list[Outcome]]] = {}
    for outcome in sorted(shown, key=lambda outcome: -(outcome.job.case.sbr or 0)):
        case = outcome.job.case
        of_picture.setdefault("files" if case.sbr is None else case.source, {}).setdefault(case, []).append(outcome)
    for source, of_case in of_picture.items():
        strips = [_strip(case, outcomes) for case, outcomes in list(of_case.items())[:MOST_STRIPS]]
        draw_clouds(folder / f"reconstructions_{source}.png", strips, f"{source}: reconstructions, coloured by range")


def _strip(case: Case, outcomes: Sequence[Outcome]) -> Strip:
    """The truth and the clouds of one case."""
    observation = case.observe()
    truth = observation.true_cloud(case.sensor)
    panels = [] if truth is None else [Panel("truth" if case.sbr else "reference", truth, f"{len(truth):,} points")]
    panels += [Panel(job.label, cloud, _caption(row)) for job, cloud, row in outcomes]
    ppp = f"{case.ppp or observation.frame.photons / case.sensor.pixels:.3g}"
    what = case.source if case.sbr is None else f"SBR {case.sbr:g}"
    label = f"{what}, {ppp} {'photon' if ppp == '1' else 'photons'} per pixel"
    return Strip(label, case.sensor, panels)


def _caption(row: dict) -> str:
    if "true_detections_percent" in row:
        return (f"TD {row['true_detections_percent']:.1f} %  FD {row['false_detections_percent']:.1f} %\n"
                f"DAE {row['dae_mm']:.3g} mm")
    nats = f"  {row['held_out_nats']:.1f} nats / 100 pixels" if row["held_out"] else ""
    return f"{row['points']:,} points{nats}"
