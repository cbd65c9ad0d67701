"""recording/motion_film.py: the way and both clouds of a moving sensor, in the fixed frame."""

import numpy as np
from rerun.chunk import RrdReader

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.motion import Pose
from srt3d_ros.recording.motion_film import Moment, write_film


def cloud(xyz) -> PointCloud:
    count, none = len(xyz), np.zeros(len(xyz), np.float32)
    return PointCloud(np.zeros(count, np.uint16), np.arange(count, dtype=np.uint16), none, none, none,
                      np.array(xyz, np.float32), np.zeros(count, np.uint8), np.zeros((1, count), np.float32))


def test_clouds_are_recorded_where_the_sensor_was_without_what_is_above(tmp_path):
    pose = Pose(Pose.turned([0, 0, np.pi / 2]).rotation, np.array([1.0, 2, 0.5]))
    points = [[1.0, 0, 0], [0, 0, 5]]
    moments = [Moment(k * 10**8, pose, {"left": cloud(points), "right": cloud(points[:1])}) for k in range(3)]
    path = tmp_path / "film.rrd"
    write_film(path, moments, ("left", "right"), (0.0, 3.0), (0.0, 0, 1))
    found: dict[str, list] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name in ("Points3D:positions", "LineStrips3D:strips"):
                found.setdefault(str(chunk.entity_path), []).extend(batch.column(name).to_pylist())
    assert set(found) == {"/clouds/left", "/clouds/right", "/way"}
    for name in ("/clouds/left", "/clouds/right"):
        np.testing.assert_allclose(found[name], [[[1, 3, 0.5]]] * 3, atol=1e-6)
    assert sorted(len(strip) for strips in found["/way"] for strip in strips) == [1, 2, 3]
