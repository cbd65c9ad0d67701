"""Gates made from events hold the same photons."""

import numpy as np
import pytest

from srt3d_ros.core import photons
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(rows=2, cols=3, num_bins=50, bin_width_s=1e-10, irf=[1.0], gates=GateWords(100, 7))


def sorted_pairs(events: PhotonEvents) -> list[tuple[int, int]]:
    return sorted(zip(events.pixel.tolist(), events.toa.tolist()))


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)], ids=["sorted", "unsorted"])
def test_gates_and_events_hold_the_same_photons(order):
    pixel, toa = np.array([0, 0, 0, 2, 5], np.uint32)[order], np.array([3, 1, 49, 0, 7], np.uint16)[order]
    gates = PhotonGates.from_events(PhotonEvents(pixel, toa, stamp_ns=9), SENSOR)
    assert gates.words.shape == (3, 2, 3) and gates.stamp_ns == 9
    assert (gates.words == 7).sum() == 3 * 6 - 5
    assert sorted_pairs(gates.to_events(SENSOR)) == sorted(zip(pixel.tolist(), toa.tolist()))


def test_no_photons_are_one_empty_cycle():
    none = PhotonGates.from_events(PhotonEvents(np.array([], np.uint32), np.array([], np.uint16)), SENSOR)
    assert none.words.shape == (1, 2, 3) and (none.words == 7).all()


def test_photons_that_would_need_too_much_memory_or_lie_outside_are_refused(monkeypatch):
    monkeypatch.setattr(photons, "MAX_WORDS", 10)
    twice = PhotonEvents(np.array([1, 1], np.uint32), np.array([4, 4], np.uint16))
    with pytest.raises(InvalidInput, match="2 cycles of 6 pixels"):
        PhotonGates.from_events(twice, SENSOR)
    with pytest.raises(InvalidInput, match="toa is 60"):
        PhotonGates.from_events(PhotonEvents(np.array([1], np.uint32), np.array([60], np.uint16)), SENSOR)


def test_gates_of_no_cycle_have_no_photons():
    sensor = SensorModel(2, 3, 50, 1e-10, [1.0], gates=GateWords(first_word=3, no_detection=0))
    events = PhotonGates(np.zeros((0, 2, 3), np.uint16)).to_events(sensor)
    assert events.photons == 0 and events.pixel.dtype == np.uint32


def test_a_word_below_the_first_is_named_not_wrapped():
    sensor = SensorModel(2, 3, 65_535, 1e-10, [1.0], gates=GateWords(first_word=3, no_detection=0))
    with pytest.raises(InvalidInput, match="^gates word is 1: expected 3 to 65535, or 0 for no detection"):
        PhotonGates(np.ones((1, 2, 3), np.uint16)).to_events(sensor)
