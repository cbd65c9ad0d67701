"""The rerun blueprint of recordings: a large 3D view; images, and tabs of plots beside it."""

from collections.abc import Collection
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.pictures.colours import BACKGROUND, GREEN, ORANGE, SKY_BLUE, YELLOW
from srt3d_ros.pictures.viewpoint import Viewpoint
from srt3d_ros.recording import entities
from srt3d_ros.recording.entities import FRAME_INDEX, STAMP, metric_path, rgba

# Plots from the first tab to the last: the legend and colour of each metric.
PLOTS = {
    "Latency [ms]": {"latency_ms": ("end to end", YELLOW), "latency_sketch_ms": ("sketch", GREEN),
                     "latency_reconstruct_ms": ("reconstruct", SKY_BLUE)},
    "Points": {"points": ("points", SKY_BLUE)},
    "Photons per pixel": {"ppp": ("photons per pixel", GREEN)},
    "Rate [Hz]": {"frame_rate_hz": ("clouds/s", ORANGE)},
}
ROOM_S = 10.0                       # how long a moving sensor's clouds stay
_WIDE_ASPECT = 2.0                  # columns over rows above which images are stacked


def cloud_view(eye: Viewpoint, moving_rate_hz: float | None = None) -> rrb.Spatial3DView:
    """The 3D view of the cloud and the sensor, orbiting about the target of `eye`; empty rays are hidden at first.

    With the rate of clouds of a moving sensor, it shows the clouds and the way of the last ROOM_S, too.
    """
    controls = rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye.position, look_target=eye.target,
                                 eye_up=eye.up)
    contents = [entities.POINTS_PATH, entities.SENSOR_PATH, entities.FREE_PATH]
    overrides: dict[Any, Any] = {entities.FREE_PATH: rrb.EntityBehavior(visible=False)}
    if moving_rate_hz is not None:
        bound = rrb.TimeRangeBoundary.cursor_relative
        overrides |= {path: rrb.VisibleTimeRanges([
            rrb.VisibleTimeRange(FRAME_INDEX, start=bound(seq=round(-ROOM_S * moving_rate_hz)), end=bound(seq=last)),
            rrb.VisibleTimeRange(STAMP, start=bound(seconds=-ROOM_S), end=bound(seconds=last / moving_rate_hz))])
            for path, last in ((entities.ROOM_PATH, -1), (entities.WAY_PATH, 0))}   # the cloud of now would flicker
        contents = [entities.POINTS_PATH, entities.MOVING_SENSOR_PATH, *overrides]
    return rrb.Spatial3DView(origin="/", name="Point cloud", contents=contents, background=BACKGROUND, line_grid=False,
                             eye_controls=controls, overrides=overrides)


def film_blueprint(eye: Viewpoint, sensor: SensorModel, images: tuple[str, ...], rate_hz: float,
                   moving: bool = False) -> rrb.Blueprint:
    """Blueprint that plays all frames in a loop: the cloud on the left; images and plots on the right.

    `rate_hz` are the frames per second. For a sensor that is `moving`, the 3D view stands in the fixed frame.
    """
    panes = _image_panes(images)
    wide = sensor.cols > _WIDE_ASPECT * sensor.rows
    grid = [rrb.Grid(*panes, grid_columns=1 if wide else len(panes))] if panes else []
    plots = rrb.Tabs(*(_plot(title, names) for title, names in PLOTS.items()), active_tab=0)
    time = rrb.TimePanel(state="collapsed", timeline=FRAME_INDEX, fps=rate_hz, play_state="playing", loop_mode="all")
    view = cloud_view(eye, rate_hz if moving else None)
    return rrb.Blueprint(rrb.Horizontal(view, rrb.Vertical(*grid, plots), column_shares=[3, 2]),
                         rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"), time,
                         auto_views=False, auto_layout=False)


def plot_styles() -> dict[str, rr.SeriesLines]:
    """Style of each plotted metric by entity path."""
    return {metric_path(name): rr.SeriesLines(colors=rgba(colour), names=title, widths=1.5)
            for metrics in PLOTS.values() for name, (title, colour) in metrics.items()}


def _plot(title: str, names: Collection[str]) -> rrb.TimeSeriesView:
    corner = rrb.PlotLegend(rrb.Corner2D.LeftTop) if len(names) > 1 else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=entities.METRICS_PATH, contents=[metric_path(name) for name in names], name=title,
                              plot_legend=corner)


def _image_panes(images: Collection[str]) -> list[rrb.Spatial2DView | rrb.Tabs]:
    """The depth, and the images of photons on tabs."""
    views = {path: rrb.Spatial2DView(origin=path, name=name, background=BACKGROUND)
             for path, name in entities.IMAGE_TITLES.items() if path in images}
    depth = [view for path, view in views.items() if path == entities.DEPTH_PATH]
    photons = [view for path, view in views.items() if path != entities.DEPTH_PATH]
    return [*depth, rrb.Tabs(*photons, active_tab=0)] if photons else [*depth]
