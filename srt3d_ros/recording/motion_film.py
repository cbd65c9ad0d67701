"""A recording of a sensor that moves: its way, and the clouds of two methods side by side, in the fixed frame."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from srt3d_ros.colours import levels, range_table
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.motion import Pose
from srt3d_ros.core.viewpoint import Viewpoint
from srt3d_ros.recording.blueprint import film, last_frames, view_from

FRAMES_SHOWN = 15           # at once: what does not fit together can be seen
RADIUS_M = 0.008
FOV_DEG = 55                # of the viewer
WAY, SENSOR, CLOUDS = "/way", "/sensor", "/clouds"
YELLOW = (240, 228, 66)


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame: its stamp, the pose of the sensor then, and the clouds by the names of their views."""

    stamp_ns: int
    pose: Pose
    clouds: dict[str, PointCloud]


def write_film(path: Path, moments: Iterable[Moment], names: tuple[str, ...], heights_m: tuple[float, float],
               middle_m: tuple[float, float, float]) -> None:
    """Record moments as they come.

    Args:
        names: of the views, from left to right.
        heights_m: z of the fixed frame at the ends of the colours. What is higher, a ceiling, is left out.
        middle_m: what the views look at, from above.
    """
    stream = rr.RecordingStream("srt3d_ros_motion")
    stream.save(path, default_blueprint=_blueprint(names, np.array(middle_m)))
    stream.log("/", rr.ViewCoordinates.FLU, static=True)
    way: list[np.ndarray] = []
    for number, moment in enumerate(moments):
        stream.set_time("frame", sequence=number)
        stream.set_time("stamp", duration=moment.stamp_ns * 1e-9)
        way.append(moment.pose.translation)
        stream.log(WAY, rr.LineStrips3D([way], colors=YELLOW, radii=0.01))
        stream.log(SENSOR, rr.Transform3D(translation=moment.pose.translation, mat3x3=moment.pose.rotation),
                   rr.TransformAxes3D(0.3))
        for name, cloud in moment.clouds.items():
            xyz = moment.pose(cloud.xyz)
            xyz = xyz[xyz[:, 2] < heights_m[1]]
            colour = range_table()[levels(xyz[:, 2], *heights_m)]
            stream.log(_entity(name), rr.Points3D(xyz, colors=colour, radii=RADIUS_M))
    stream.flush()
    stream.disconnect()


def _entity(name: str) -> str:
    return f"{CLOUDS}/{name.replace(' ', '_')}"


def _blueprint(names: tuple[str, ...], middle_m: np.ndarray) -> rrb.Blueprint:
    eye = Viewpoint(middle_m + (-5.0, -5.0, 9.0), middle_m, np.array([0, 0, 1]), FOV_DEG)
    return film(rrb.Horizontal(*(view_from(eye, name, contents=[_entity(name), WAY, SENSOR],
                                           time_ranges=[last_frames(FRAMES_SHOWN)]) for name in names)), "frame")
