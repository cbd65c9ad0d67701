"""Draw an evaluation's clouds side by side. Needs matplotlib."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import SubFigure

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.evaluation.cases import Case
from srt3d_ros.evaluation.run import Outcome
from srt3d_ros.pictures.cloud_renderer import CloudStyle
from srt3d_ros.pictures.figures import save_png, titled_figure
from srt3d_ros.pictures.viewpoint import look_at

_MOST_ROWS = 10                 # in a picture; more are not readable
_PANEL_IN, _ROW_IN, _TITLE_IN = 2.5, 3.2, 0.4
_CLOUD_PX = 480                 # side of a drawn cloud; matplotlib shrinks it, which smooths edges


def draw(folder: Path, shown: Sequence[Outcome]) -> None:
    """Write a picture of clouds for each scene and one for all files: a row for each case, its truth first if known."""
    of_picture: dict[str, dict[Case, list[Outcome]]] = {}
    for outcome in sorted(shown, key=lambda outcome: -(outcome.case.sbr or 0)):
        case = outcome.case
        of_picture.setdefault("files" if case.sbr is None else case.source, {}).setdefault(case, []).append(outcome)
    for source, outcomes in of_picture.items():
        rows = [(case, of_case, _panels(case, of_case)) for case, of_case in list(outcomes.items())[:_MOST_ROWS]]
        columns = max(len(panels) for *_, panels in rows)
        figure = titled_figure(_PANEL_IN * max(columns, 2), _ROW_IN * len(rows) + _TITLE_IN,
                               f"{source}: reconstructions, coloured by range")
        for row, (case, of_case, panels) in zip(figure.subfigures(len(rows), 1, squeeze=False)[:, 0], rows):
            ppp = f"{case.ppp or of_case[0].row['photons_per_pixel']:.3g}"
            what = case.source if case.sbr is None else f"SBR {case.sbr:g}"
            row.suptitle(f"{what}, {ppp} {'photon' if ppp == '1' else 'photons'} per pixel", x=0.01, ha="left",
                         size=11, weight="bold", parse_math=False)
            draw_row(row, columns, panels)
        save_png(figure, folder / f"reconstructions_{source}.png")


def draw_row(figure: SubFigure, columns: int, panels: Sequence[tuple[str, PointCloud, str]]) -> None:
    """Draw clouds, each with heading and caption; the first sets viewpoint and colours of all."""
    all_axes = figure.subplots(1, columns, squeeze=False)[0]
    for axes in all_axes:
        axes.set_axis_off()
    first = panels[0][1]
    style, eye = CloudStyle.of(first, first.sensor), look_at(first.xyz, first.sensor.projection)
    for axes, (heading, cloud, caption) in zip(all_axes, panels):
        axes.imshow(style.draw(cloud, eye, _CLOUD_PX, _CLOUD_PX, finer=1))
        axes.set_title(heading, loc="left", size=10, parse_math=False)
        axes.text(0, -0.03, caption, transform=axes.transAxes, va="top", size=8.5, parse_math=False)


def _panels(case: Case, outcomes: Sequence[Outcome]) -> list[tuple[str, PointCloud, str]]:
    """Heading, cloud and caption of the truth and of each outcome."""
    truth = case.observe().true_cloud(case.sensor)
    panels = [] if truth is None else [("truth" if case.sbr else "reference", truth, f"{len(truth):,} points")]
    return panels + [(run.label, cloud, _caption(row)) for _, run, cloud, row in outcomes]


def _caption(row: dict) -> str:
    if "true_detections_percent" in row:
        return (f"TD {row['true_detections_percent']:.1f} %  FD {row['false_detections_percent']:.1f} %\n"
                f"DAE {row['dae_mm']:.3g} mm")
    nats = f"  {row['held_out_nats']:.1f} nats / 100 pixels" if row["held_out"] else ""
    return f"{row['points']:,} points{nats}"
