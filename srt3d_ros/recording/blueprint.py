"""How a recording looks when it is first opened: the cloud, large; the depth image; a plot for each metric."""

import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.recording.layout import DEPTH, POINTS, STAMP, metric_path
from srt3d_ros.viewpoint import Viewpoint

# Title and line colour of the plots, in the order shown. Colours by Okabe and Ito, told apart by everyone.
PLOTS = {
    "latency_ms": ("Latency [ms]", (240, 228, 66)),
    "points": ("Points", (86, 180, 233)),
    "photons": ("Photons", (0, 158, 115)),
    "drops": ("Drops", (213, 94, 0)),
}
_BACKGROUND = (13, 16, 21)


def cloud_view(eye: Viewpoint) -> rrb.Spatial3DView:
    """The 3D view, seen by `eye`; the viewer lets it be turned about the cloud's middle."""
    return rrb.Spatial3DView(
        origin="/", contents=[POINTS], name="Point cloud, coloured by intensity", background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye.position, look_target=eye.target,
                                       eye_up=eye.up),
    )


def film_blueprint(eye: Viewpoint) -> rrb.Blueprint:
    """For a recording of many frames: cloud on the left, depth image and plots on the right."""
    plots = [rrb.TimeSeriesView(origin=metric_path(name), name=title, plot_legend=rrb.PlotLegend(visible=False))
             for name, (title, _) in PLOTS.items()]
    side = rrb.Vertical(_depth_view(), *plots, row_shares=[3] + [1] * len(plots))
    return rrb.Blueprint(
        rrb.Horizontal(cloud_view(eye), side, column_shares=[2, 1]),
        rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=STAMP, play_state="playing", loop_mode="all"),
        auto_views=False, auto_layout=False,
    )


def still_blueprint(eye: Viewpoint) -> rrb.Blueprint:
    """For a single cloud: the cloud, and its depth image beside it."""
    return rrb.Blueprint(
        rrb.Horizontal(cloud_view(eye), _depth_view(), column_shares=[2, 1]), collapse_panels=True,
        auto_views=False, auto_layout=False,
    )


def plot_styles() -> dict[str, rr.SeriesLines]:
    """The static style of each plotted metric, by its entity path."""
    return {metric_path(name): rr.SeriesLines(colors=colour, names=title, widths=1.5)
            for name, (title, colour) in PLOTS.items()}


def _depth_view() -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=DEPTH, name="Depth", background=_BACKGROUND)
