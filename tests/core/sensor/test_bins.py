"""HistogramBins: where bins lie, and which are refused."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import histogram
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.errors import InvalidInput

SHAPE = (2, 3)


def sensor(bins):
    return SensorModel(*SHAPE, 100, 1e-10, [1.0, 2, 1], histograms=bins)


def test_the_middles_of_bins():
    assert HistogramBins(3).centers().tolist() == [0.5, 1.5, 2.5]
    assert HistogramBins(3, first_bin=10, bin_width=4).centers().tolist() == [12, 16, 20]


@pytest.mark.parametrize(("bins", "named"), [
    (HistogramBins(101), "histograms.num_bins is 101"),
    (HistogramBins(10, first_bin=-1), "histograms.first_bin is -1"),
    (HistogramBins(10, bin_width=0), "histograms.bin_width is 0"),
    (HistogramBins(10, bin_width=np.nan), "histograms.bin_width is nan: expected a finite number of bins"),
    (HistogramBins(10, first_bin=np.ones(SHAPE)), "histograms.first_bin is .*: expected a finite number of bins"),
    (HistogramBins(10, first_bin=95), "10 bins that end at 105: expected at most T = 100"),
    (HistogramBins(10, template=np.ones(9)), r"histograms.template shape is \(9,\)"),
    (HistogramBins(10, template=-np.ones(10)), "histograms.template is negative"),
])
def test_bins_that_no_sensor_of_this_size_has_are_refused(bins, named):
    with pytest.raises(InvalidInput, match=named):
        sensor(bins)


def test_the_histogram_of_a_scene_is_on_the_axis():
    """A wall in bin 60 before a background."""
    bins = HistogramBins(30, 20.0, 2.0)
    middles = np.broadcast_to(bins.centers(), (6, 30))
    frame = PhotonHistograms(np.where(np.abs(middles - 60) < 1.1, 200, 10).astype(np.int32).reshape(*SHAPE, -1))
    found = histogram(frame, sensor(bins))
    assert found.sum() == frame.photons and abs(int(found.argmax()) - 60) <= 1


@pytest.mark.parametrize("dtype, gate", [(np.int32, None), (np.float32, (30, 69))])
def test_what_is_left_of_subtracted_light_is_still_a_mean_of_unit_vectors(dtype, gate):
    own = SensorModel(*SHAPE, 100, 1e-10, [1.0, 2, 1])
    sketcher = FrameSketcher(own, (1, 2, 5), gate=gate and Gate(own, *gate))
    for seed in range(3):
        noise = np.random.default_rng(seed).poisson(50, (*SHAPE, 100)) - 50
        sketcher.add(PhotonHistograms(noise.astype(dtype)))
        sketch = sketcher.end_frame()
    assert np.abs(sketch.z).max() <= 1.001 and sketch.photons.max() < 100 * 50
    assert (np.abs(sketch.sums).max(axis=2) > sketch.photons - 1).any()         # n is no more than that needs
