"""CameraInfo: where a point of the sensor is seen, and the lens."""

import numpy as np

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.messages.images_message import camera_info


def test_it_projects_a_point_of_the_sensor_onto_its_pixel(small_sensor):
    sensor = small_sensor.replace(projection=Pinhole(fx=50.0, fy=60.0, cx=1.5, cy=1.0))
    info = camera_info(sensor, 1_500_000_000, "lidar")
    x, y, z = sensor.xyz(np.array([2]), np.array([3]), np.array([40.0]))[0]
    for matrix, point in ((info.k.reshape(3, 3), [x, y, z]), (info.p.reshape(3, 4), [x, y, z, 1])):
        u, v, w = matrix @ point
        np.testing.assert_allclose([u / w, v / w], [3, 2], atol=1e-5)
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (3, 4, "plumb_bob", [0.0] * 5)
    assert (info.r.reshape(3, 3) == np.eye(3)).all() and (info.binning_x, info.roi.width) == (0, 0)
    assert (info.header.stamp.sec, info.header.stamp.nanosec, info.header.frame_id) == (1, 500_000_000, "lidar")


def test_a_lens_is_in_d_and_a_scanner_has_none(small_sensor):
    lens = Pinhole(50.0, 60.0, 7.5, 5.25, PlumbBob(-0.2, 0.05, 0.01, -0.005, 0.002))
    info = camera_info(small_sensor.replace(projection=lens), 0, "lidar")
    assert list(info.d) == [-0.2, 0.05, 0.01, -0.005, 0.002]
    assert (info.k.reshape(3, 3) == [[50, 0, 7.5], [0, 60, 5.25], [0, 0, 1]]).all()
    scanner = small_sensor.replace(projection=AngularScan(0.1, -0.01, 0.2, -0.01))
    assert camera_info(scanner, 0, "lidar") is None
