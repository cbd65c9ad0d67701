"""The scene that is simulated beside the bust."""

import numpy as np

from srt3d_ros.evaluation.scenes import NetScene, net_sensor


def test_the_net_hangs_before_the_plane_and_waves():
    scene = NetScene(net_sensor())
    net, plane = scene.frame(0)[0]
    both = np.isfinite(net) & np.isfinite(plane)
    assert 0.5 < both.mean() < 1 and (plane[both] - net[both]).min() > 0.8
    later = scene.frame(1.0)[0]
    assert np.nanmax(np.abs(later[0] - net)) > 0.05 and np.array_equal(later[1], plane, equal_nan=True)
