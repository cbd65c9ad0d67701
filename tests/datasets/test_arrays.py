"""Photons in memory: every type of array, what is assumed, and what is refused in one line."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.datasets import arrays
from srt3d_ros.datasets.options import Options, fields_of
from srt3d_ros.datasets.reading import Said
from srt3d_ros.errors import InvalidInput
from srt3d_ros.photons import Photons
from tests.core.scenes import simulate
from tests.photon_forms import as_histograms

IRF = np.array([0.2, 0.5, 0.3])
KNOWN = {"shape": (3, 4), "num_bins": 50, "bin_width_s": 1e-10, "irf": IRF, "fov_deg": 20, "toa_offset_bins": 0}
ROW, COL, TOA = [0, 2, 1, 2], [3, 0, 1, 3], [49, 0, 7, 20]
PIXEL = [3, 8, 5, 11]


def events(row=ROW, col=COL, toa=TOA, sensor=None, **changes):
    return Photons.from_events(row, col, toa, sensor=sensor, **(KNOWN | changes if sensor is None else changes))


def counts(cube, sensor=None, **changes):
    given = {name: value for name, value in KNOWN.items() if name not in ("shape", "num_bins")}
    return Photons.from_counts(cube, sensor=sensor, **((given if sensor is None else {}) | changes))


def cube(dtype=np.uint16):
    values = np.zeros((3, 4, 50), dtype)
    np.add.at(values, (ROW, COL, TOA), 1)
    return values


@pytest.mark.parametrize("dtype", [np.int8, np.uint64, np.float16, np.float64, ">u2"])
@pytest.mark.filterwarnings("error")
def test_every_type_of_number_gives_the_same_photons(dtype):
    found = events(*(np.array(values, dtype) for values in (ROW, COL, TOA)))
    assert found.frame.pixel.tolist() == PIXEL and found.frame.toa.tolist() == TOA
    assert found.frame.pixel.dtype == np.uint32 and found.frame.toa.dtype == np.uint16
    histograms = counts(cube(dtype))
    assert np.array_equal(histograms.frame.counts, cube()) and histograms.frame.photons == 4


def test_lists_tensors_and_strided_arrays():
    torch = pytest.importorskip("torch")
    for convert in (list, torch.tensor, lambda values: torch.tensor(values, dtype=torch.float32, requires_grad=True),
                    lambda values: np.repeat(values, 2)[::2]):
        found = events(*map(convert, (ROW, COL, TOA)), irf=torch.tensor(IRF))
        assert found.frame.pixel.tolist() == PIXEL and found.frame.toa.tolist() == TOA
        assert found.sensor.irf == pytest.approx(IRF)
    assert np.array_equal(counts(torch.tensor(cube(np.int32))).frame.counts, cube())


def test_times_between_bins_stay_and_one_below_t_stays_below_it():
    found = events(toa=[0.25, 1.0, 2.5, np.nextafter(50, 0)]).frame.toa
    assert found.dtype == np.float32 and found[:3].tolist() == [0.25, 1, 2.5] and 49.9 < found[3] < 50


@pytest.mark.parametrize("stray", [[50, -1], [np.nan, -0.5], [np.inf, -np.inf]])
def test_photons_outside_the_bins_are_dropped_and_counted(stray):
    found = events(toa=[49, stray[0], 7, stray[1]])
    assert found.frame.pixel.tolist() == [3, 5] and found.frame.toa.tolist() == [49, 7]
    assert found.notes == ("2 of 4 photons lie outside 0 to below 50 bins: dropped",)


@pytest.mark.parametrize(("values", "dtype"), [((0, 256), np.uint16), ((-1, 9), np.int32), ((0, 70_000), np.int32)])
def test_counts_get_the_smallest_type_that_holds_them(values, dtype):
    large = np.zeros((3, 4, 50), np.int64)
    large[0, 0, :2] = values
    assert counts(large).frame.counts.dtype == dtype
    assert counts(large.astype(np.float64)).frame.counts.dtype == np.float32
    kept = large.astype(np.int32)
    assert np.shares_memory(counts(kept).frame.counts, kept)


def test_hot_pixels_are_masked_counted_and_left_out_of_the_estimated_irf():
    seen = SensorModel(20, 20, 400, 1e-10, np.exp(-0.5 * ((np.arange(31) - 10) / 3)**2))
    depth = 100 + 4 * np.arange(20.0) + np.zeros((20, 1))
    cube = as_histograms(simulate(depth, 5, 30, seen), seen).counts
    cube.reshape(400, 400)[[45, 300]] += 20
    found, off = (Photons.from_counts(cube, bin_width_s=1e-10, **options)
                  for options in ({}, {"mask": "off"}))
    assert np.flatnonzero(~found.sensor.used).tolist() == [45, 300] and off.sensor.used.all()
    assert "2 hot pixels of 400" in found.notes[0] and "mask=auto" in off.notes[0]
    by_hand = Photons.from_counts(cube, bin_width_s=1e-10, mask=found.sensor.used)
    for other in (off, by_hand):
        np.testing.assert_array_equal(found.sensor.irf, other.sensor.irf)
    assert read(off.frame, sensor=off.sensor).sensor.used.all()       # a given sensor keeps its mask
    of_bag = arrays.from_frame(off.frame, Options(), Said(fields_of(off.sensor)))
    assert "2 hot pixels" in of_bag.notes[0] and of_bag.sensor.used.all()
    again = read(off.frame, sensor=off.sensor, mask="auto").sensor
    np.testing.assert_array_equal(again.used, found.sensor.used)


def test_half_a_bin_is_noted_until_time_zero_is_known():
    for options, number in (({}, 1), ({"bin_width_s": 1e-11}, 0), ({"toa_offset_bins": 0.5}, 0),
                            ({"range_offset_m": 0.1}, 0), ({"toa": [0.25, 7, 9, 3.5]}, 0), ({"bin_width_s": None}, 0)):
        notes = [note for note in events(**{"toa_offset_bins": None} | options).notes if "truncates" in note]
        assert len(notes) == number and all(note.startswith("ranges are 7.49 mm short") for note in notes)


@pytest.mark.parametrize(("dark", "dtype"), [(1, np.uint8), (3, np.uint16), (1, np.float64)])
def test_counts_that_wrapped_are_refused(dark, dtype):
    counted = np.random.default_rng(0).poisson(0.3, (6, 8, 50)).astype(np.uint16 if dtype == np.float64 else dtype)
    with pytest.raises(InvalidInput, match=r"counts are (255|65533|65535).* wrapped .*Subtract signed ones"):
        counts((counted - counted.dtype.type(dark)).astype(dtype))
    bright = np.random.default_rng(0).integers(0, 400, (6, 8, 50)).clip(0, 255).astype(np.uint8)
    counts(bright)                      # saturated, not wrapped


def test_a_first_cloud_needs_neither_bin_width_nor_measured_irf():
    found = events(bin_width_s=None, irf=None, irf_sigma_bins=1.5)
    assert found.sensor.bin_width_m == pytest.approx(1) and [note[:9] for note in found.notes] == ["bin width"]
    assert found.sensor.irf[found.sensor.irf_ref + 3] / found.sensor.irf.max() == pytest.approx(np.exp(-2))


@pytest.mark.parametrize("method", ["pooled", "xcorr"])
def test_an_empty_frame_gives_an_empty_cloud_and_a_note(method):
    cloud = events([], [], []).reconstruct(method=method)
    assert len(cloud) == 0 and cloud.notes == ("the frame has no photons, so its cloud has no points",)


def test_what_is_unlikely_to_be_meant_is_noted():
    sparse = counts(12 * cube())                                        # 4 photons a pixel
    assert sparse.sketch().notes == sparse.sketch(2).notes == ()
    assert sparse.sketch(3).notes == ("the sketch is longer than its photons: 6 numbers a pixel for 4 photons",)
    note, = counts(2 * cube(np.int32) - 1).notes
    assert note.startswith("negative counts outweigh the positive ones")


@pytest.mark.parametrize(("changes", "said"), [
    ({"row": None}, "row dtype is object: expected numbers"),
    ({"toa": TOA[:3]}, r"row, col and toa shapes is \(4,\), \(4,\), \(3,\): expected one entry a photon"),
    ({"row": [0, 1, 2, 3]}, "row is 3: expected 0 to below 3"), ({"col": [0, 1, 2, -1]}, "col is -1: expected 0 to"),
    ({"row": [0, 1.5, 2, 2]}, r"row is \[1.5\]: expected whole numbers"), ({"col": [0, 1, 2, 2**32]}, "col is 4294"),
    ({"col": [[0], [1, 2]]}, r"col is list \(setting an array element"), ({"toa": [1j] * 4}, "toa dtype is complex128"),
    ({"toa": [0, 50, 51, 70_000]}, "3 of 4 photons lie outside 0 to below 50 bins: num_bins is probably wrong"),
    ({"toa": np.ma.masked_equal(TOA, 7)}, "toa has masked values: fill them or leave them out"),
    ({"bin_width_s": 0.1}, "50 bins of 0.1 s reach 7.49e[+]08 m: give bin_width_s in seconds"),
    ({"mask": np.zeros((3, 4), bool)}, "mask is False everywhere"),
    ({"shape": None}, r"Give shape=\(rows, cols\), or sensor"), ({"shape": 12}, "shape is 12: "),
    ({"num_bins": None}, "Give num_bins, the bins of a laser period"),
    ({"toa": [1e-9, 2e-9, 3e-9, 1e-10]}, "All toa are below 1. They count bins: divide seconds by"),
    ({"irf_sigma_bins": 2}, "Give irf_sigma_bins or irf, not both"),
    ({"irf": None, "irf_ref": 2}, "irf_ref needs irf"),
    ({"projection": AngularScan(0, 1, 0, 1)}, "Give fov_deg or projection, not both"),
    ({"sensor": SensorModel(3, 4, 50, 1e-10, IRF, gain=np.ones((3, 4))), "shape": (4, 3)}, "gain shape is "),
])
def test_a_mistake_is_one_line_that_names_it(changes, said):
    with pytest.raises(InvalidInput, match=f"^{said}") as refused:
        events(**changes)
    assert str(refused.value).isprintable() and isinstance(refused.value, ValueError)


@pytest.mark.parametrize(("values", "changes", "said"), [
    (np.ones((3, 4)), {}, r"counts is float64 \(3, 4\): expected numbers \[rows, cols, bins\]"),
    (np.ma.masked_equal(cube(), 0), {}, "counts has masked values: fill them or leave them out"),
    (-cube(np.int32), {}, "No count is above 0. If the signal is inverted, negate it"),
    (np.full((3, 4, 50), np.nan), {}, "counts holds infinite numbers or NaN"),
    (np.full((3, 4, 50), 2**40), {}, "counts is 1099511627776: expected 32-bit numbers"),
    (np.ones((3, 4, 10)), {"histograms": HistogramBins(10)}, "Give num_bins"),
    (np.zeros((3, 4, 50)), {"irf": None}, "Too few photons to estimate the IRF: give irf"),
    (np.ones((3, 4, 10)), {"irf": None, "num_bins": 50, "histograms": HistogramBins(10, 3, 4)},
     "Give irf, widened by these bins")])
def test_counts_that_cannot_be_are_refused(values, changes, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        counts(values, **changes)
