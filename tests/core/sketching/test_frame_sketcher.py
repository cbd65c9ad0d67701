"""Sketching against its definition, and that packets add up whatever their split and order."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, MAX_SKETCH_SIZE, PhaseSums, check_frequencies
from srt3d_ros.errors import InvalidInput
from tests import photon_forms
from tests.core.scenes import assert_same_sketch

FREQUENCIES = (1, 2, 7, 49)
SENSOR = SensorModel(4, 6, 100, 1e-10, [1, 2, 1], gates=GateWords(first_word=3, no_detection=0))
# A sum of n unit vectors in float32 errs by less than n · 2⁻²⁴ · (1 + their number): 1e-6 n leaves room for 16 of them.
EACH = 1e-6


def photons(count=5_000, sensor=SENSOR, seed=0, dtype=np.uint16, ordered=True) -> PhotonEvents:
    """Photons that leave some pixels dark and crowd into others."""
    rng = np.random.default_rng(seed)
    pixel = (sensor.pixels * rng.beta(0.6, 0.9, count)).astype(np.uint32) // 2 * 2
    toa = rng.uniform(0, sensor.num_bins, count).astype(np.float32).clip(0, np.nextafter(sensor.num_bins, 0.0))
    return PhotonEvents(np.sort(pixel) if ordered else pixel, toa.astype(dtype), stamp_ns=1_000)


def definition(events: PhotonEvents, sensor=SENSOR, frequencies=FREQUENCIES) -> tuple[np.ndarray, np.ndarray]:
    """z_l = (1/n) Σ_p exp(i ω_l x_p) and n, in float64, pixel by pixel, of times in steps of 1/16 bin."""
    omega = 2 * np.pi * np.array(frequencies) / sensor.num_bins
    z = np.zeros((sensor.pixels, len(frequencies)), np.complex128)
    n = np.zeros(sensor.pixels, int)
    for pixel in np.unique(events.pixel):
        x = np.rint(16 * events.toa[events.pixel == pixel].astype(np.float64)) / 16
        z[pixel], n[pixel] = np.exp(1j * np.outer(x, omega)).mean(axis=0), len(x)
    return z.reshape(sensor.rows, sensor.cols, -1), n.reshape(sensor.rows, sensor.cols)


@pytest.mark.parametrize("ordered", [True, False], ids=["sorted", "unsorted"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_sketch_is_the_mean_of_the_photons_phases(dtype, ordered):
    events = photons(dtype=dtype, ordered=ordered)
    assert events.is_sorted is ordered
    assert not sketch_photons(photons(0, dtype=dtype), SENSOR, FREQUENCIES).photons.any()
    sketch = sketch_photons(events, SENSOR, FREQUENCIES)
    z, n = definition(events)
    assert np.array_equal(sketch.photons, n) and (n == 0).any() and n.max() > 300
    assert sketch.sums.dtype == np.complex64 and sketch.photons.dtype == np.uint32
    np.testing.assert_allclose(sketch.z, z, atol=EACH)
    assert sketch.frequencies == FREQUENCIES and sketch.stamp_ns == 1_000


@pytest.mark.parametrize(("num_bins", "steps"), [(100, 16), (20_000, 3), (65_535, 1), (65_536, 1)])
def test_times_with_fractions_are_rounded_as_finely_as_16_bits_allow(num_bins, steps):
    sensor = SensorModel(1, 4, num_bins, 1e-10, [1.0])
    toa = np.array([0, 1 / 3, num_bins - 2 + 0.4, num_bins - 0.004], np.float32)
    found = sketch_photons(PhotonEvents(np.arange(4, dtype=np.uint32), toa), sensor, (1, num_bins // 2 - 1))
    turns = np.outer(np.rint(toa.astype(np.float64) * steps) / steps, found.frequencies) / num_bins
    np.testing.assert_allclose(found.sums[0], np.exp(2j * np.pi * turns), atol=EACH)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 400), number=st.integers(1, 6), ordered=st.booleans(),
       as_gates=st.sets(st.integers(0, 5)))
def test_packets_in_any_split_order_and_form_give_the_same_sketch_to_the_bit(seed, count, number, ordered, as_gates):
    rng = np.random.default_rng(seed)
    events = photons(count, seed=seed, ordered=ordered)
    owner = rng.integers(0, number, count)
    parts = [PhotonEvents(events.pixel[owner == k], events.toa[owner == k], stamp_ns=100 + k)
             for k in range(owner.max() + 1)]
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)
    for k in rng.permutation(len(parts)):
        sketcher.add(photon_forms.as_gates(parts[k], SENSOR) if k in as_gates else parts[k])
    sketch = sketcher.end_frame()
    assert_same_sketch(sketch, sketch_photons(events, SENSOR, FREQUENCIES), each=0)
    assert sketch.stamp_ns == 100


def test_bins_of_crosstalk_are_left_out_as_its_noise_would_be_a_surface():
    """400 photons of it a pixel beside 20 of a plane and as many of background; a uniform background adds nothing."""
    irf, num_bins = np.exp(-0.5 * ((np.arange(9) - 4) / 1.5) ** 2), 128
    crosstalk = np.zeros(num_bins, np.float32)
    crosstalk[4:13] = 400 * irf / irf.sum()
    sensor = SensorModel(16, 16, num_bins, 1e-10, irf, histograms=HistogramBins(num_bins, template=crosstalk))
    expected = crosstalk + np.float32(20 / num_bins)
    seen = sketch_photons(PhotonHistograms(np.broadcast_to(expected, (16, 16, num_bins)).copy(), 0), sensor, (1, 5, 20))
    np.testing.assert_allclose(seen.sums, 0, atol=1e-3)
    np.testing.assert_allclose(seen.photons, 20)
    expected[66:75] += 20 * irf / irf.sum()
    counts = np.random.default_rng(3).poisson(expected, (16, 16, num_bins)).astype(np.uint16)
    seen = sketch_photons(PhotonHistograms(counts, 0), sensor, tuple(range(1, 11)))
    cloud = Pooled(sensor, seen.frequencies, device="cpu")(seen)
    assert len(cloud) > 0.98 * sensor.pixels and np.abs(cloud.depth_bins - 70).max() < 3


def test_a_frame_has_the_cycles_of_its_packets_and_counts_those_of_gates():
    sensor = SENSOR.replace(cycles=100, gates=GateWords())
    sketcher = FrameSketcher(sensor, FREQUENCIES)
    for _ in range(2):
        sketcher.add(photons(20))
        sketcher.add(photons(20))
        assert sketcher.end_frame().cycles == 200
    sketcher = FrameSketcher(sensor, (1, 4), gate=Gate(sensor, 40, 60))
    words = np.full((7, 4, 6), 65_535, np.uint16)
    words[:, 0, 0] = 20, 20, 39, 40, 50, 60, 61
    for packets in (1, 2):
        for _ in range(packets):
            sketcher.add(PhotonGates(words))
        sketch = sketcher.end_frame()
        assert (sketch.cycles, sketch.before[0, 0], sketch.photons[0, 0], sketch.before.sum()) == (
            7 * packets, 3 * packets, 3 * packets, 3 * packets)


def test_cycles_of_histograms_from_which_light_was_subtracted_are_not_known():
    for lowest, cycles in ((0, 100), (-1, 0)):
        counts = np.linspace(lowest, 1, 2400, dtype=np.float32).reshape(4, 6, 100)
        sensor = SENSOR.replace(cycles=100, gates=None)
        assert sketch_photons(PhotonHistograms(counts), sensor, FREQUENCIES).cycles == cycles


def test_more_photons_than_32_bits_hold_are_a_full_pixel_of_the_same_mean():
    counts = np.zeros((4, 6, 100), np.int32)
    counts[1, 2, 20:80] = 40_000_000
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)
    for packets, seen in ((1, 2_400_000_000), (2, MAX_PIXEL_PHOTONS)):
        for _ in range(packets):
            sketcher.add(PhotonHistograms(counts))
        sketch = sketcher.end_frame()
        assert sketch.photons[1, 2] == seen
        expected = sketch_photons(PhotonHistograms(counts // 1000), SENSOR, FREQUENCIES)
        np.testing.assert_allclose(sketch.z[1, 2], expected.z[1, 2], rtol=1e-5, atol=1e-7)


# ---- Sums: which frequencies they may have, and that they add

def small(rows: int, cols: int, bin_width_s: float = 1e-10) -> SensorModel:
    return SensorModel(rows, cols, 100, bin_width_s, [1.0])


def make(rows=2, cols=3, frequencies=(1, 4), seed=0, stamp_ns=0, **changes) -> PhaseSums:
    rng = np.random.default_rng(seed)
    photons = rng.integers(0, 9, (rows, cols)).astype(np.uint32)
    phases = np.exp(1j * rng.uniform(0, 6, (rows, cols, len(frequencies))))
    return PhaseSums(frequencies, (photons[..., None] * phases).astype(np.complex64), photons, stamp_ns,
                  sensor=small(rows, cols, **changes))


@pytest.mark.parametrize(("call", "said"), [
    *((partial(check_frequencies, k, 100), said) for k, said in (
        ([], "sketch size is 0"), (range(1, MAX_SKETCH_SIZE + 2), f"sketch size is {MAX_SKETCH_SIZE + 1}"),
        ([0], "frequencies is 0"), ([1.5], "frequencies is 1.5"), ([float("nan")], "frequencies is nan"),
        ([1, 2, 1], r"frequencies is \[1, 2, 1\]: expected no frequency twice"))),
    *((lambda changes=changes: make() + make(**changes), said) for changes, said in (
        ({"frequencies": (1, 5)}, r"frequencies is \(1, 5\): expected the same as \(1, 4\)"),
        ({"rows": 1}, r"Cannot add sketches of different sensors \(rows 2 and 1\)\."),
        ({"bin_width_s": 1e-9}, r"Cannot add sketches of different sensors \(bin_width_s 1e-10 and 1e-09\)\."))),
    (lambda: replace(make(), frequencies=(1, 2, 3)), "sums shape"),
    (lambda: replace(make(), before=np.ones((3, 2), np.uint32)), "before shape"),
    (lambda: replace(make(), exposure=np.ones(6, np.float32)), "exposure shape")])
def test_what_cannot_be_used_is_refused(call, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        call()


def test_z_is_the_mean_and_sketches_add_with_their_cycles_and_the_earliest_stamp():
    sketch = PhaseSums((1, 2), np.array([[[4, 2j], [1, 1j], [0, 0]]], np.complex64), np.array([[4, 1, 0]], np.uint32),
                    sensor=small(1, 3))
    assert sketch.z.dtype == np.complex64
    np.testing.assert_allclose(sketch.z, [[[1, 0.5j], [1, 1j], [0, 0]]])
    one, other = make(seed=1, stamp_ns=7), make(seed=2, stamp_ns=5)
    total = one + other
    np.testing.assert_allclose(total.sums, one.sums + other.sums)
    assert np.array_equal(total.photons, one.photons + other.photons) and total.stamp_ns == 5
    assert total.sums.dtype == np.complex64 and total.photons.dtype == np.uint32
    one, before = make(), np.ones((2, 3), np.uint32)
    known, gated = replace(one, cycles=100), replace(one, cycles=50, before=before)
    assert (known + known).cycles == 200 and (known + known).before is None
    assert (known + gated).cycles == 150 and (gated + gated).before.tolist() == [[2] * 3] * 2
    assert (known + one).cycles == (one + known).cycles == 0
    assert (gated.armed_cycles == 49).all()


def test_a_part_has_the_maps_of_its_pixels():
    maps = np.arange(6, dtype=np.uint32).reshape(2, 3)
    part = replace(make(), before=maps, exposure=maps.astype(np.float32))[1:, 1:]
    assert part.before.tolist() == part.exposure.tolist() == [[4, 5]] and part.sensor.shape == (1, 2)


def test_sums_of_more_photons_than_32_bits_hold_are_a_full_pixel_of_the_same_mean():
    photons = np.full((2, 2), 3_000_000_000, np.uint32)
    sketch = PhaseSums((1,), ((0.6 + 0.8j) * photons[..., None]).astype(np.complex64), photons, sensor=small(2, 2))
    total = sketch + sketch
    assert (total.photons == MAX_PIXEL_PHOTONS).all() and total.photons.dtype == np.uint32
    np.testing.assert_allclose(total.z, 0.6 + 0.8j, rtol=1e-6)
