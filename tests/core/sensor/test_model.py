"""SensorModel: what it refuses, and what it says about where photons come from."""

import copy

import numpy as np
import pytest

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.difference import first_difference
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import MAX_BINS, GateWords, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.errors import InvalidInput

IRF = [0.0, 1.0, 3.0, 2.0]
SHAPE = (2, 3)


def make(**changes) -> SensorModel:
    return SensorModel(**({"rows": 2, "cols": 3, "num_bins": 50, "bin_width_s": 1e-10, "irf": IRF} | changes))


def holed(value) -> np.ndarray:
    """A map of ones with one pixel of another value."""
    image = np.ones(SHAPE)
    image[1, 2] = value
    return image


REFUSED = {
    "rows": (0, 2.5, "two", None, float("nan"), 65_537, 10**400), "cols": ([3], float("inf")),
    "num_bins": (1, MAX_BINS + 1), "bin_width_s": (0.0, float("nan"), 1e-320, 2.0),
    "extrinsics": (7, [0, 0, 1]), "toa_offset_bins": (float("inf"),), "range_offset_m": (None,),
    "irf": ([1, -1e-9], [1, float("inf")], [0, 0], [[1, 1]] * 5 + [[0, 0]], "flat", [[1, 2], [1]], [1, 10**400],
            [1e308, 1e308]),
    "irf_ref": (-1, 4, 0.5), "cycles": (0, -3, 1.5, "many", 2e9), "dead_time_s": (-1e-9, np.nan),
    "period_s": (1e-12,), "gain": (holed(1e-5), holed(1e300), holed(np.nan)),
    "delay_bins": (holed(-2e6), holed(1e300), holed(np.nan), "late"),
    "background_shape": (np.zeros(50), np.arange(-1, 49), "even"),
    "irf shape": ([], np.ones((5, 4)), np.ones((1, 6, 4))), "irf length": (np.ones(51), np.ones((6, 51))),
    "gain shape": (np.ones((3, 2)), np.ones(6)), "delay_bins shape": (np.zeros((2, 2)),),
    "mask shape": (np.ones((2, 3, 1), bool),), "background_shape shape": (np.ones(49), np.ones((1, 50))),
}


@pytest.mark.parametrize("named", REFUSED)
@pytest.mark.filterwarnings("error")
def test_what_cannot_be_used_is_refused_by_name_in_one_line(named):
    for value in REFUSED[named]:
        with pytest.raises(InvalidInput) as caught:
            make(**{named.split()[0]: value})
        assert caught.value.field == named and len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("changes", [{"toa_offset_bins": -1e300}, {"range_offset_m": 2e12}])
def test_ranges_too_long_for_float32_are_refused(changes):
    with pytest.raises(InvalidInput, match="^range is"):
        make(**changes)


def test_irf_is_normalised_its_peak_marks_the_depth_and_30_degrees_are_seen():
    sensor = make()
    assert sensor.irf.dtype == np.float32 and sensor.irf.tolist() == pytest.approx([0, 1 / 6, 1 / 2, 1 / 3])
    assert sensor.irf_ref == 2 and make(irf_ref=0).irf_ref == 0
    assert type(make(rows=2.0).rows) is type(make(cols=np.uint16(3)).cols) is int
    several = make(irf=np.array([[1, 0, 0]] + [[0, 0, 2]] * 5))
    assert several.irf.sum(axis=1).tolist() == [1] * 6 and several.irf_ref == 2         # the peak of their sum
    assert sensor.projection == Pinhole.from_fov(2, 3, 30.0)


def test_points_lie_on_their_pixels_rays_at_the_range():
    sensor = make(toa_offset_bins=1000, range_offset_m=0.5)
    np.testing.assert_allclose(sensor.range_m([0, 10.25]), np.array([1000, 1010.25]) * 299_792_458 / 2 * 1e-10 + 0.5)
    row, col, depth = np.array([0, 1, 1]), np.array([2, 0, 1]), np.array([0, 10.5, 49], np.float32)
    xyz = sensor.xyz(row, col, depth)
    assert xyz.shape == (3, 3) and xyz.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(xyz, axis=1), sensor.range_m(depth), rtol=1e-6)
    np.testing.assert_allclose(xyz / sensor.range_m(depth)[:, None], sensor.rays[row, col], rtol=1e-6)


def test_replace_changes_one_field_and_checks_again():
    sensor = make(gain=np.full(SHAPE, 2.0), projection=AngularScan(0, 0.1, 0, 0.1))
    shape = make(background_shape=np.arange(50)).background_shape
    assert shape.sum() == pytest.approx(1) and np.array_equal(make(background_shape=shape).background_shape, shape)
    changed = sensor.replace(num_bins=60)
    assert changed.num_bins == 60 and changed.gain is sensor.gain and changed.projection == sensor.projection
    assert np.array_equal(changed.irf, sensor.irf) and sensor.num_bins == 50
    with pytest.raises(InvalidInput, match="gain shape"):
        sensor.replace(rows=3)


FULL = {"irf_ref": 1, "toa_offset_bins": 7.5, "range_offset_m": 0.1, "gain": np.full(SHAPE, 2.0),
        "delay_bins": np.ones(SHAPE), "mask": np.eye(2, 3, dtype=bool), "projection": Pinhole(1, 1, 0, 0),
        "gates": GateWords(1, 0), "frame_id": "spad", "extrinsics": "0 0 1 0 0 0 1", "background_shape": np.ones(50),
        "histograms": HistogramBins(10, first_bin=1.0, bin_width=2.0, template=np.ones(10))}


def test_same_as_sees_equal_values_in_other_arrays():
    sensor = make(**FULL)
    assert sensor.same_as(make(**copy.deepcopy(FULL))) and not sensor.same_as(None)


# ---- Some of the pixels

@pytest.mark.parametrize("projection", [Pinhole(9, 8, 2.5, 1, PlumbBob(k1=-0.01)), AngularScan(0.2, -0.1, 0.3, -0.2)])
def test_a_cropped_sensor_sees_with_each_pixel_what_it_saw(projection):
    maps = np.arange(1, 25, dtype=np.float32).reshape(4, 6)
    bins = HistogramBins(5, first_bin=1.0, bin_width=2.0, template=np.arange(120.0).reshape(24, 5))
    sensor = SensorModel(4, 6, 50, 1e-10, np.eye(24, 30) + 0.1, gain=maps, delay_bins=maps, mask=maps > 8,
                         projection=projection, histograms=bins, background_shape=np.arange(50))
    part = sensor.cropped(slice(1, -1), slice(3, None))
    assert (part.rows, part.cols) == (2, 3)
    np.testing.assert_allclose(part.rays, sensor.rays[1:-1, 3:], atol=1e-6)
    for name in ("gain", "delay_bins", "mask"):
        assert np.array_equal(getattr(part, name), getattr(sensor, name)[1:-1, 3:]), name
    assert (part.histograms.first_bin, part.histograms.bin_width) == (1, 2)
    for name, values in (("irf", part.irf), ("template", part.histograms.template)):
        whole = sensor.irf if name == "irf" else bins.template
        assert np.array_equal(values, whole[[9, 10, 11, 15, 16, 17]]), name
    assert np.array_equal(part.background_shape, sensor.background_shape) and part.irf_ref == sensor.irf_ref
    assert sensor.cropped(slice(None)).same_as(sensor)


def test_no_pixels_and_pixels_apart_are_refused():
    for rows, shown in ((slice(4, 9), r"slice\(4, 9, None\)"), (slice(3, 3), ""), (slice(None, None, 2), ""), (2, 2)):
        with pytest.raises(InvalidInput, match=f"^rows is {shown}.*: expected a slice with some of 0:4 in it"):
            SensorModel(4, 6, 50, 1e-10, [1.0]).cropped(rows)


# ---- In which key two descriptions differ

SEEN = SensorModel(rows=3, cols=4, num_bins=50, bin_width_s=1e-10, irf=[1, 2, 1], projection=Pinhole(9, 9, 1.5, 1))


@pytest.mark.parametrize("changes, expected", [
    ({"rows": 4, "num_bins": 60}, ("rows", 3, 4)),          # the first in the order of the schema
    ({"irf": [1, 2, 1, 0]}, ("irf shape", (3,), (4,))),
    ({"irf": [1, 1, 2], "irf_ref": 1}, ("irf[1]", 0.5, 0.25)),
    ({"bin_width_s": 2e-10}, ("bin_width_s", 1e-10, 2e-10)),
    ({"toa_offset_bins": 1e-9}, ("toa_offset_bins", 0.0, 1e-9)),
    ({"mask": np.eye(3, 4) == 0}, ("mask", "absent", "given")),
    ({"gain": np.arange(1, 13).reshape(3, 4)}, ("gain[0, 1]", 1.0, 2.0)),
    ({"projection": AngularScan(0.0, 0.1, 0.0, 0.1)}, ("projection.kind", "pinhole", "angular_scan")),
    ({"projection": Pinhole(9, 9, 1.5, 1, PlumbBob(k1=-0.1))}, ("projection.distortion.k1", 0.0, -0.1)),
    ({"gates": GateWords(7)}, ("gates", "absent", "given")),
    ({"frame_id": "mast"}, ("frame_id", "lidar", "mast")),
])
def test_the_first_key_that_differs_and_both_values(changes, expected):
    before = SEEN.replace(gain=np.ones((3, 4))) if "gain" in changes else SEEN
    after = before.replace(**changes)
    assert first_difference(before, after) == expected and not before.same_as(after)


def test_what_six_digits_do_not_tell_apart_is_the_same():
    assert first_difference(SEEN, SEEN.replace(bin_width_s=1.000001e-10, irf=SEEN.irf * 1.000001)) is None
    assert first_difference(SEEN, SEEN.replace(bin_width_s=1.0001e-10))[0] == "bin_width_s"


def binned(bins):
    return make(num_bins=100, irf=[1, 2, 1], histograms=bins)


@pytest.mark.parametrize(("bins", "named"), [
    (HistogramBins(101), "histograms.num_bins is 101"),
    (HistogramBins(10, bin_width=np.nan), "histograms.bin_width is nan: expected 1e-06 to 65536 bins"),
    (HistogramBins(10, first_bin=np.ones(SHAPE)), "histograms.first_bin is .*: expected 0 to 65536 bins"),
    (HistogramBins(10, first_bin=95), "10 bins that end at 105: expected at most T = 100"),
    (HistogramBins(10, template=np.ones(9)), r"histograms.template shape is \(9,\)"),
    (HistogramBins(10, template=-np.ones(10)), "histograms.template is negative"),
])
def test_bins_that_no_sensor_of_this_size_has_are_refused(bins, named):
    with pytest.raises(InvalidInput, match=named):
        binned(bins)


@pytest.mark.parametrize("dtype, gate", [(np.int32, None), (np.float32, (30, 69))])
def test_what_is_left_of_subtracted_light_is_still_a_mean_of_unit_vectors(dtype, gate):
    own = binned(None)
    sketcher = FrameSketcher(own, (1, 2, 5), gate=gate and Gate(own, *gate))
    for seed in range(3):
        noise = np.random.default_rng(seed).poisson(50, (*SHAPE, 100)) - 50
        sketcher.add(PhotonHistograms(noise.astype(dtype)))
        sketch = sketcher.end_frame()
    assert np.abs(sketch.z).max() <= 1.001 and sketch.photons.max() < 100 * 50
    assert (np.abs(sketch.sums).max(axis=2) > sketch.photons - 1).any()         # n is no more than that needs
