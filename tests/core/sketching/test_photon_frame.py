"""PhotonEvents and PhotonGates: what they refuse, and that one becomes the other without losing a photon."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.errors import InvalidInput
from tests.photon_forms import as_gates, as_histograms

SENSOR = SensorModel(3, 4, 100, 1e-10, np.ones(3), gates=GateWords(first_word=10, no_detection=5))


def events(pixel, toa, dtype=np.uint16, stamp_ns=0) -> PhotonEvents:
    return PhotonEvents(np.array(pixel, np.uint32), np.array(toa, dtype), stamp_ns)


def histograms(counts, dtype=np.uint16, **fields) -> PhotonHistograms:
    return PhotonHistograms(np.asarray(counts, dtype), **fields)


def gates(word: int, shape=(1, 3, 4)) -> PhotonGates:
    words = np.full(shape, 10, np.uint16)
    words[0, 2, 2] = word
    return PhotonGates(words)


@pytest.mark.parametrize(("make", "said"), [
    (lambda: events([0, 1], [0, 1], np.float64), "toa dtype is"),
    (lambda: PhotonEvents(np.zeros(2, np.int64), np.zeros(2, np.uint16)), "pixel dtype is"),
    (lambda: events([[0, 1]], [[0, 1]]), "pixel and toa shapes is"),
    (lambda: PhotonGates(np.zeros((2, 3, 4), np.int16)), "gates dtype is"),
    (lambda: PhotonGates(np.zeros((2, 12), np.uint16)), "gates shape is"),
    (lambda: histograms(np.zeros((3, 4, 100)), np.int64), "histograms dtype is"),
    (lambda: histograms(np.zeros((3, 400))), "histograms shape is"),
    *((lambda last=last: events([0, last, 3], [0] * 3), f"pixel is {last}: expected an index below 3 × 4 = 12$")
      for last in (12, 2**32 - 1)),
    (lambda: events([0, 1], [0, 100]), r"toa is 100: expected bins in \[0, 100\)$"),
    *((lambda toa=toa: events([0, 1], [3, toa], np.float32), f"toa is {toa}: ")
      for toa in (100.0, -0.25, np.nan, -np.inf)),
    (lambda: gates(110), "gates word is 110: expected 10 to 109, or 5 for no detection$"),
    (lambda: gates(9), "gates word is 9: "), (lambda: gates(10, (1, 4, 3)), r"gates shape is \(1, 4, 3\)"),
    # A word below the first is not wrapped.
    (lambda: PhotonGates(np.ones((1, 2, 3), np.uint16)).to_events(SensorModel(
        2, 3, 65_535, 1e-10, [1.0], gates=GateWords(3, 0))), "gates word is 1: expected 3 to 65535, or 0 for no"),
    (lambda: histograms(np.zeros((3, 4, 99))), r"histograms shape is \(3, 4, 99\): expected .*\(3, 4, 100\)"),
    *((lambda count=count, dtype=dtype: histograms(np.full((3, 4, 100), count), dtype), f"histograms count is {count}")
      for count, dtype in ((np.nan, np.float32), (1e9, np.float32), (-10**9, np.int32), (2**31 - 1, np.int32))),
    *((lambda count=count: histograms(np.full((3, 4, 100), count), np.float32).to_events(SENSOR), ".*negative or frac")
      for count in (-1, 0.5))])
def test_what_cannot_be_used_is_named(make, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        make().check(SENSOR)


@pytest.mark.parametrize(("dtype", "last"), [(np.uint16, 99), (np.float32, 99.99)])
def test_the_last_bins_and_as_many_photons_as_a_pixel_may_have_are_inside(dtype, last):
    events([11], [last], dtype).check(SENSOR)
    counts = np.zeros((3, 4, 100))
    counts[1, 2, 7] = 2**31 - 1
    histograms(counts, np.int32).check(SENSOR)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_events_become_gates_and_events_again(dtype):
    rng = np.random.default_rng(1)
    frame = events(rng.integers(0, 12, 200), rng.integers(0, 100, 200), dtype, stamp_ns=77)
    back = as_gates(frame, SENSOR).to_events(SENSOR)
    order = np.argsort(frame.pixel, kind="stable")
    assert back.is_sorted and back.stamp_ns == 77 and back.toa.dtype == np.uint16
    assert as_gates(events([], []), SENSOR).to_events(SENSOR).photons == 0
    assert np.array_equal(back.pixel, frame.pixel[order]) and np.array_equal(back.toa, frame.toa[order])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
def test_histograms_count_their_photons(dtype):
    counts = np.random.default_rng(1).integers(0, 255, (3, 4, 100))
    assert histograms(counts, dtype).photons == counts.sum()
    assert histograms(np.full((10, 1, 65_535), 65_535)).photons == 10 * 65_535**2
    assert histograms(np.full((3, 4, 100), -1), np.int32).photons == 0          # less than was subtracted


@pytest.mark.parametrize("dtype, last", [(np.uint16, 99), (np.float32, 98.6)])
def test_events_become_histograms_and_back(dtype, last):
    given = events([11, 1, 1, 4], [last, 7, 7, 0], dtype, stamp_ns=5)
    made = as_histograms(given, SENSOR)
    assert made.counts.dtype == np.uint16 and made.photons == 4 and made.stamp_ns == 5
    back = made.to_events(SENSOR)
    assert back.pixel.tolist() == [1, 1, 4, 11] and back.toa.tolist() == [7, 7, 0, 99]


def test_counts_lie_in_the_middle_of_their_bin_on_the_axis_without_their_template():
    bins = HistogramBins(20, first_bin=10, bin_width=2.5)
    counts = np.zeros((3, 4, 20))
    counts[0, 0, 0], counts[0, 0, 1] = 1, 1             # middles 11.25 and 13.75 bins from the beginning of bin 0
    found = histograms(counts).to_events(SENSOR.replace(histograms=bins))
    assert found.toa.dtype == np.float32 and found.toa.mean() == 12 and np.ptp(found.toa) == 2.5
    bins = HistogramBins(2, first_bin=5, bin_width=4, template=np.array([1, 0]))
    found = histograms(np.full((3, 4, 2), 3)).on_axis(SENSOR.replace(histograms=bins))
    assert found.shape == (3, 4, 100) and found.sum() == 12 * 5
    assert np.flatnonzero(found[1, 1]).tolist() == [7, 11] and found[1, 1, 7] == 2
