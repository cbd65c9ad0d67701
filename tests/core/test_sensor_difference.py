"""In which key two descriptions differ."""

import numpy as np
import pytest

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sensor_difference import first_difference

SENSOR = SensorModel(rows=3, cols=4, num_bins=50, bin_width_s=1e-10, irf=[1, 2, 1], projection=Pinhole(9, 9, 1.5, 1))
SCAN = AngularScan(0.0, 0.1, 0.0, 0.1)


@pytest.mark.parametrize("changes, expected", [
    ({"rows": 4, "num_bins": 60}, ("rows", 3, 4)),          # the first in the order of the schema
    ({"num_bins": 60}, ("num_bins", 50, 60)),
    ({"bin_width_s": 2e-10}, ("bin_width_s", 1e-10, 2e-10)),
    ({"irf": [1, 2, 1, 0]}, ("irf shape", (3,), (4,))),
    ({"irf": [1, 1, 2], "irf_ref": 1}, ("irf[1]", 0.5, 0.25)),
    ({"toa_offset_bins": 1e-9}, ("toa_offset_bins", 0.0, 1e-9)),
    ({"mask": np.eye(3, 4) == 0}, ("mask", "absent", "given")),
    ({"projection": SCAN}, ("projection.kind", "pinhole", "angular_scan")),
    ({"projection": Pinhole(9, 9, 1.5, 1, PlumbBob(k1=-0.1))}, ("projection.distortion.k1", 0.0, -0.1)),
    ({"gates": GateWords(7)}, ("gates", "absent", "given")),
    ({"frame_id": "mast"}, ("frame_id", "lidar", "mast")),
])
def test_the_first_key_that_differs_and_both_values(changes, expected):
    assert first_difference(SENSOR, SENSOR.replace(**changes)) == expected


def test_of_a_map_the_first_pixel_that_differs():
    masks = [np.ones((3, 4), bool), np.ones((3, 4), bool)]
    masks[1][2, 1] = False
    assert first_difference(*(SENSOR.replace(mask=mask) for mask in masks)) == ("mask[2, 1]", True, False)


def test_what_six_digits_do_not_tell_apart_is_the_same():
    assert first_difference(SENSOR, SENSOR.replace(bin_width_s=1.000001e-10, irf=SENSOR.irf * 1.000001)) is None
    assert first_difference(SENSOR, SENSOR.replace(bin_width_s=1.0001e-10))[0] == "bin_width_s"
