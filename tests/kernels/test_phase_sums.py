"""Photons → sketch: sums of exp(i ω x), which are exact, however the work is split."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.kernels import cpu
from srt3d_ros.kernels.cpu.sketching import phase_sums
from srt3d_ros.kernels.maps import MAX_ROWS

PIXELS, T = 40, 50
EACH = 2e-7         # how far a sum may be off for each photon: rows are rounded to 2⁻²⁴, and sums to float32


def sketch(function, *arguments, frequencies, pixels=PIXELS):
    """Sums, numbers of photons and what lies in memory, after a kernel has added photons."""
    table = FrameSketcher(histogram_sensor(), frequencies).phase_table(np.arange(T) + 0.5)
    fixed = cpu.fixed_rows(table)
    sums = cpu.new_sums(pixels, fixed)
    arrays = [each for each in arguments if isinstance(each, np.ndarray)]
    rest = [each for each in arguments if not isinstance(each, np.ndarray)]
    for array in arrays:
        array.flags.writeable = False       # as the sketcher gives them: compiled once
    getattr(cpu, function)(*arrays, fixed, *rest, sums)
    return *cpu.read_sums(sums, len(frequencies)), sums


def draw(count=700, ordered=False, pixels=PIXELS, seed=2):
    """Photons that leave some pixels dark and crowd into others."""
    rng = np.random.default_rng(seed)
    pixel = (pixels * rng.beta(0.4, 0.9, count)).astype(np.uint32) // 2 * 2
    toa = rng.integers(0, T, count, dtype=np.uint16)
    return np.sort(pixel) if ordered else pixel, toa


def assert_close(found, pixel, toa, frequencies):
    """Sums and numbers are Σ exp(2πi k x / T) and n, but for rounding."""
    z, numbers, _ = found
    expected = np.zeros(z.shape, complex)
    np.add.at(expected, pixel, np.exp(2j * np.pi * np.outer(toa.astype(float), frequencies) / T))
    assert z.dtype == np.complex64 and numbers.dtype == np.uint32
    assert np.array_equal(numbers, np.bincount(pixel, minlength=len(z)))
    assert (np.abs(z - expected) <= EACH * np.maximum(numbers, 1)[:, None]).all()


@pytest.mark.parametrize("frequencies", [(3,), (1, 3, 24), tuple(range(1, 9)), tuple(range(2, 12)), tuple(range(1, 13)),
                                         tuple(range(1, 18)), tuple(range(1, 25))], ids=len)
@pytest.mark.parametrize("ordered", [True, False], ids=["sorted", "unsorted"])
def test_sketch_sizes_of_every_width(ordered, frequencies):
    pixel, toa = draw(2_000, ordered=ordered)
    numbers = np.bincount(pixel, minlength=PIXELS)
    assert numbers.max() > MAX_ROWS and (numbers == 0).any()
    found = sketch("sketch_events", pixel, toa, ordered, frequencies=frequencies)
    assert_close(found, pixel, toa, frequencies)


@pytest.mark.parametrize(("cycles", "pixels"), [(7, 1), (7, 130), (2 * phase_sums.TILE_CYCLES + 5, 3)])
@pytest.mark.parametrize(("first_word", "no_detection"), [(0, 65_535), (10, 3), (0, 0), (65_480, 5)])
def test_gates(cycles, pixels, first_word, no_detection):
    rng = np.random.default_rng(pixels)
    words = rng.integers(first_word, first_word + T, (cycles, pixels)).astype(np.uint16)
    words[rng.random(words.shape) < 0.3] = no_detection
    found = sketch("sketch_gates", words, first_word, no_detection, frequencies=(1, 3, 24), pixels=pixels)
    cycle, pixel = np.nonzero(words != no_detection)
    assert_close(found, pixel, words[cycle, pixel].astype(int) - first_word, (1, 3, 24))


def test_sums_are_the_same_bit_for_bit_in_any_order_split_and_form(monkeypatch):
    pixel, toa = draw(3_000)
    order = np.argsort(pixel, kind="stable")
    whole = sketch("sketch_events", pixel[order], toa[order], True, frequencies=(1, 3, 24))
    monkeypatch.setattr(phase_sums, "THREAD_PHOTONS", 50)
    others = [sketch("sketch_events", pixel[order], toa[order], True, frequencies=(1, 3, 24)),
              sketch("sketch_events", pixel, toa, False, frequencies=(1, 3, 24)),
              sketch("sketch_events", pixel[::-1].copy(), toa[::-1].copy(), False, frequencies=(1, 3, 24))]
    for other in others:
        for one, two in zip(whole, other, strict=True):
            assert np.array_equal(one, two)


def histogram_sensor(bins=None, **fields):
    return SensorModel(5, 8, T, 1e-10, [1, 2, 1], histograms=bins, **fields)


OWN_BINS = HistogramBins(12, first_bin=2.0, bin_width=3.5)
WIDE_BINS = HistogramBins(10, first_bin=5.0, bin_width=4.0, template=np.linspace(0, 0.4, 10))
OF_EACH = HistogramBins(12, 2.0, 3.5, template=np.random.default_rng(3).random((40, 12)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
@pytest.mark.parametrize("bins", [None, OWN_BINS, WIDE_BINS, OF_EACH], ids=["T", "own", "template", "of each"])
def test_histograms(dtype, bins):
    sensor, frequencies = histogram_sensor(bins), (1, 3, 11)
    n = T if bins is None else bins.num_bins
    rng = np.random.default_rng(2)
    counts = rng.integers(0, 200, (40, n)) - (30 if np.dtype(dtype).kind != "u" else 0)
    counts[7] = 0 if np.dtype(dtype).kind == "u" else -1        # below 0 there are no photons
    table, of_template = FrameSketcher(sensor, frequencies).histogram_tables
    sums = cpu.new_sums(40, cpu.fixed_rows(table))
    for _ in range(2):
        cpu.sketch_histograms(counts.astype(dtype), table, of_template, sums)
    z, numbers = cpu.read_sums(sums, 3)
    scene = counts - (0 if bins is None or bins.template is None else bins.template)
    middle = np.arange(T) if bins is None else bins.centers() - 0.5
    phases = np.exp(2j * np.pi * np.multiply.outer(np.broadcast_to(middle, (40, n)), frequencies) / T)
    wanted, seen = 2 * (scene[..., None] * phases).sum(axis=1), scene.sum(axis=1)
    some = np.arange(40) != 7                                   # without photons there is no mean to read
    assert np.abs(z - wanted)[some].max() < 1e-6 * np.abs(scene).sum(axis=1).max() * 2
    assert np.array_equal(numbers, np.rint(np.maximum(2 * seen, 0)).astype(np.int64))
