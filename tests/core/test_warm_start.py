"""A reconstruction that begins with the last frame's surfaces: better where the scene goes on, no worse where not."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.irf import spad
from srt3d_ros.datasets.scene import StaticScene, default_sensor
from srt3d_ros.datasets.simulator import Simulator

BIN_WIDTH_S = 50e-12
SENSOR = SensorModel(60, 72, 800, BIN_WIDTH_S, spad(BIN_WIDTH_S), projection=Pinhole.from_fov(60, 72))
FREQUENCIES = choose("auto", SENSOR, 10)
TOLERANCE = 0.04 / SENSOR.bin_width_m


def ranges(ball_at: int | None, ball_m: float = 2.0) -> np.ndarray:
    """A wall at 3 m, and a ball before it."""
    y, x = np.mgrid[:SENSOR.rows, :SENSOR.cols]
    range_m = 3 + 0.002 * x
    if ball_at is not None:
        range_m[np.hypot(y - 30, x - ball_at) < 14] = ball_m
    return range_m.astype(np.float32)


def seen(range_m, seed, sbr=1.0, ppp=1.0):
    """Sketch and truth of a frame."""
    frame, depth = Simulator(StaticScene(range_m), SENSOR, sbr=sbr, ppp=ppp, seed=seed).frame(0)
    return sketch_photons(frame, SENSOR, FREQUENCIES), depth


@pytest.mark.parametrize(("before", "after", "sbr", "ppp"), [
    (ranges(22), ranges(48), 1.0, 1.0), (ranges(22), ranges(None), 1.0, 10.0), (ranges(None), ranges(22), 0.1, 10.0),
    (ranges(None), ranges(22, 2.9), 1.0, 10.0)],
    ids=["moved", "gone", "come", "come a little before the wall"])
def test_a_sudden_change_of_the_scene_is_not_smeared(before, after, sbr, ppp):
    cold, warm = (Pooled(SENSOR, FREQUENCIES, warm_start=warm) for warm in (False, True))
    for seed in (1, 2):
        warm(seen(before, seed, sbr, ppp)[0])
    sketch, depth = seen(after, 3, sbr, ppp)
    one, other = (evaluate(pooled(sketch), depth, TOLERANCE, SENSOR.num_bins) for pooled in (cold, warm))
    # 8 of 2304 pixels: single ones at the edges go either way.
    assert other.true_detections >= one.true_detections - 0.0035
    assert other.false_detections <= one.false_detections + 0.0035


def test_depths_of_a_scene_that_goes_on_are_more_accurate():
    sensor = default_sensor()
    frequencies = choose("auto", sensor, 10)
    simulator = Simulator(sbr=1, ppp=3, seed=5)
    errors = []
    for pooled in (Pooled(sensor, frequencies, warm_start=warm) for warm in (False, True)):
        frames = [simulator.frame(i) for i in range(4)]
        found = [evaluate(pooled(sketch_photons(frame, sensor, frequencies)), depth, 40e-3 / sensor.bin_width_m,
                          sensor.num_bins) for frame, depth in frames]
        errors.append(np.mean([one.dae_bins for one in found[1:]]))
    assert errors[1] < 0.95 * errors[0]


def test_without_warm_start_no_frame_depends_on_the_one_before():
    pooled = Pooled(SENSOR, FREQUENCIES)
    sketch, _ = seen(ranges(22), 1)
    first = pooled(sketch)
    pooled(seen(ranges(48), 2)[0])
    again = pooled(sketch)
    np.testing.assert_array_equal(first.depth_bins, again.depth_bins)
    np.testing.assert_array_equal(first.intensity, again.intensity)
