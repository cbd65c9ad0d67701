"""Photons → sketch on every device, against the plain reference; sums are exact, however the work is split."""

import numba
import numpy as np
import pytest

from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import Sketcher, phase_table
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels import reference
from srt3d_ros.kernels.cpu import phase_sums, rows

PIXELS, T = 40, 50
# How far a sum may be off for each photon: table rows are rounded to 24 bits on the CPU, to 16 on CUDA.
EACH = {"cpu": 1e-7, "cuda": 2.3e-5}
OF_WAVES = {"cpu": 5e-7, "cuda": 3e-6}        # and for ToA with fractions


class Device:
    """The kernels of a device, fed with NumPy arrays."""

    def __init__(self, name, kernels, array, numpy):
        self.name, self.kernels, self.array, self.numpy = name, kernels, array, numpy

    def sketch(self, function, *arguments, frequencies, pixels=PIXELS, num_bins=T, table=True, times=1):
        """Sums, numbers of photons and what lies in memory, after a kernel has added photons."""
        fixed = [self.kernels.fixed_rows(self.array(phase_table(frequencies, num_bins)))] if table else []
        sums, photons = self.kernels.new_sums(pixels, 2 * len(frequencies))
        arrays = [self.array(a) for a in arguments if isinstance(a, np.ndarray)]
        rest = [a for a in arguments if not isinstance(a, np.ndarray)]
        for _ in range(times):
            getattr(self.kernels, function)(*arrays, *fixed, *rest, sums, photons)
        z, n = self.kernels.read_sums(sums, photons, 2 * len(frequencies))
        return self.numpy(z), self.numpy(n), sums if self.kernels is reference else self.numpy(sums)


REFERENCE = Device("reference", reference, reference.array, reference.numpy)


def expected_of(*arguments, **options):
    """Sums, complex128 [pixels, m], and numbers of photons, as the reference counts them."""
    _, photons, sums = REFERENCE.sketch(*arguments, **options)
    return sums, photons


@pytest.fixture(params=["cpu", "cuda", "reference"])
def any_device(request):
    """Those of `device`, and the reference."""
    return REFERENCE if request.param == "reference" else device_named(request.param, request)


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    """What is held against the reference."""
    return device_named(request.param, request)


def device_named(name, request):
    if name == "cpu":
        return Device("cpu", phase_sums, np.ascontiguousarray, np.asarray)
    cuda = request.getfixturevalue("cuda")
    from srt3d_ros.kernels.cuda import phase_sums as on_cuda
    return Device("cuda", on_cuda, cuda.array, cuda.numpy)


def draw(count=700, dtype=np.uint16, ordered=False, pixels=PIXELS, seed=2):
    """Photons that leave some pixels dark and crowd into others."""
    rng = np.random.default_rng(seed)
    pixel = (pixels * rng.beta(0.4, 0.9, count)).astype(np.uint32) // 2 * 2
    toa = rng.uniform(0, T, count).astype(np.float32).clip(0, np.nextafter(np.float32(T), np.float32(0))).astype(dtype)
    return np.sort(pixel) if ordered else pixel, toa


def assert_close(found, expected, each):
    (z, n, _), (sums, numbers) = found, expected
    assert z.dtype == np.complex64 and n.dtype == np.uint32 and np.array_equal(n, numbers)
    assert (np.abs(z - sums) <= each * np.maximum(n, 1)[:, None]).all()


@pytest.mark.parametrize("frequencies", [(3,), (1, 3, 24), tuple(range(1, 9)), tuple(range(2, 12)), tuple(range(1, 13)),
                                         tuple(range(1, 18)), tuple(range(1, 25))], ids=len)
@pytest.mark.parametrize("function", ["sketch_sorted", "sketch_unsorted"])
def test_sketch_sizes_of_every_width(device, function, frequencies):
    pixel, toa = draw(200, ordered=function == "sketch_sorted")
    found = device.sketch(function, pixel, toa, frequencies=frequencies)
    assert_close(found, expected_of("sketch_unsorted", pixel, toa, frequencies=frequencies), EACH[device.name])


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32])
@pytest.mark.parametrize("function", ["sketch_sorted", "sketch_unsorted"])
def test_pixels_of_many_photons_and_of_none(device, function, dtype):
    pixel, toa = draw(2_000, dtype, function == "sketch_sorted")
    found = device.sketch(function, pixel, toa, frequencies=(1, 3, 24))
    expected = expected_of("sketch_unsorted", pixel, toa, frequencies=(1, 3, 24))
    assert expected[1].max() > rows.MOST and (expected[1] == 0).any()
    assert_close(found, expected, EACH[device.name])


@pytest.mark.parametrize("ordered", [True, False], ids=["sorted", "unsorted"])
@pytest.mark.parametrize("frequencies", [(1, 3, 24), tuple(range(2, 12))], ids=len)
def test_times_with_fractions(device, ordered, frequencies):
    pixel, toa = draw(400, np.float32, ordered)
    found = device.sketch("sketch_continuous", pixel, toa, frequencies, T, ordered, frequencies=frequencies,
                          table=False)
    expected = expected_of("sketch_continuous", pixel, toa, frequencies, T, ordered, frequencies=frequencies,
                           table=False)
    assert_close(found, expected, OF_WAVES[device.name])


@pytest.mark.parametrize("k", [1, 50, 1_000, 32_767])
def test_phases_of_late_times_and_high_frequencies(device, k):
    toa = np.array([0, 1 / 3, 65_534.004, 65_534.996], np.float32)
    found = device.sketch("sketch_continuous", np.arange(4, dtype=np.uint32), toa, (k,), 65_535, True, frequencies=(k,),
                          pixels=4, num_bins=65_535, table=False)[0]
    expected = np.exp(2j * np.pi * k * toa.astype(np.float64) / 65_535)
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=OF_WAVES[device.name] + 2 * np.pi * k / 2**31)


@pytest.mark.parametrize("pixels", [1, 17, 130])
@pytest.mark.parametrize(("first_word", "no_detection"), [(0, 65_535), (10, 3), (0, 0), (65_480, 5)])
def test_gates(device, pixels, first_word, no_detection):
    rng = np.random.default_rng(pixels)
    words = rng.integers(first_word, first_word + T, (7, pixels)).astype(np.uint16)
    words[rng.random(words.shape) < 0.3] = no_detection
    kernels = device.kernels
    table = phase_table((1, 3, 24), T)
    sums, photons = kernels.new_sums(pixels, 6)
    assert kernels.find_stray(device.array(words), first_word, no_detection, T) == -1
    kernels.sketch_gates(device.array(words), kernels.fixed_rows(device.array(table)), first_word, no_detection, sums,
                         photons)
    found = [device.numpy(a) for a in (*kernels.read_sums(sums, photons, 6), sums)]
    assert_close(found, expected_of("sketch_gates", words, first_word, no_detection, frequencies=(1, 3, 24),
                                    pixels=pixels), EACH[device.name])


def test_gates_of_more_cycles_than_are_read_together():
    words = np.random.default_rng(0).integers(0, T + 1, (2 * phase_sums.CYCLES + 5, 3)).astype(np.uint16)
    sums, photons = phase_sums.new_sums(3, 2)
    phase_sums.sketch_gates(words, phase_sums.fixed_rows(phase_table((3,), T)), 0, T, sums, photons)
    expected = expected_of("sketch_gates", words, 0, T, frequencies=(3,), pixels=3)
    assert_close((*phase_sums.read_sums(sums, photons, 2), sums), expected, EACH["cpu"])


@pytest.mark.parametrize("word", [0, 9, 60, 65_535])
@pytest.mark.parametrize("pixel", [0, 8, 16])
def test_a_stray_word_is_found_in_any_pixel(any_device, word, pixel):
    words = np.full((5, 17), 3, np.uint16)
    words[2, pixel] = word
    assert any_device.kernels.find_stray(any_device.array(words), 10, 3, T) == word


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32, np.float32])
@pytest.mark.parametrize("where", [0, 99, 4_999, 10_000])
def test_a_photon_outside_and_a_drop_are_seen_wherever_they_are(any_device, dtype, where, monkeypatch):
    monkeypatch.setattr(phase_sums, "PART", 700)
    pixel, toa = np.full(10_001, 5, np.uint32), np.full(10_001, T - 1, dtype)

    def inspect(pixel, toa):
        return any_device.kernels.inspect_events(any_device.array(pixel), any_device.array(toa), 6, T)

    assert inspect(pixel, toa) == (True, True)
    wrong = toa.copy()
    for wrong[where] in [T, 2 * T] + ([-0.5, np.nan, np.inf] if dtype == np.float32 else [np.iinfo(dtype).max]):
        assert inspect(pixel, wrong)[0] is False
    wrong = pixel.copy()
    for wrong[where] in (6, 2**32 - 1):
        assert inspect(wrong, toa)[0] is False
    wrong[where] = 4
    assert inspect(wrong, toa) == (True, where == 0)


def test_sums_are_the_same_bit_for_bit_in_any_order_split_and_form(device, monkeypatch):
    pixel, toa = draw(3_000)
    order = np.argsort(pixel, kind="stable")
    whole = device.sketch("sketch_sorted", pixel[order], toa[order], frequencies=(1, 3, 24))
    monkeypatch.setattr(phase_sums, "PART", 50)
    monkeypatch.setattr(phase_sums, "BLOCK", 900)
    monkeypatch.setattr(phase_sums, "BUCKETS", 2)
    others = [device.sketch("sketch_sorted", pixel[order], toa[order].astype(np.uint32), frequencies=(1, 3, 24)),
              device.sketch("sketch_unsorted", pixel, toa, frequencies=(1, 3, 24)),
              device.sketch("sketch_unsorted", pixel[::-1].copy(), toa[::-1].copy(), frequencies=(1, 3, 24))]
    for other in others:
        for one, two in zip(whole, other, strict=True):
            assert np.array_equal(one, two)


@pytest.mark.parametrize("function", ["sketch_sorted", "sketch_unsorted", "sketch_continuous"])
def test_the_number_of_threads_changes_nothing(function):
    device = Device("cpu", phase_sums, np.ascontiguousarray, np.asarray)
    continuous, ordered = function == "sketch_continuous", function != "sketch_unsorted"
    pixel, toa = draw(100_000, np.float32 if continuous else np.uint16, ordered)
    more = ((1, 3), T, True) if continuous else ()
    before = numba.get_num_threads()
    try:
        found = []
        for threads in (1, before):
            numba.set_num_threads(threads)
            found.append(device.sketch(function, pixel, toa, *more, frequencies=(1, 3), table=not continuous))
    finally:
        numba.set_num_threads(before)
    assert all(np.array_equal(one, two) for one, two in zip(*found, strict=True))


def test_unsorted_photons_of_many_more_pixels(device, monkeypatch):
    monkeypatch.setattr(phase_sums, "BUCKETS", 4)
    pixel, toa = draw(300, pixels=300)
    found = device.sketch("sketch_unsorted", pixel, toa, frequencies=(1, 3), pixels=300)
    assert_close(found, expected_of("sketch_unsorted", pixel, toa, frequencies=(1, 3), pixels=300), EACH[device.name])


@pytest.mark.parametrize("function", ["sketch_unsorted", "sketch_continuous"])
def test_bright_pixels_are_shared_among_programs_and_summed_in_segments(cuda, monkeypatch, function):
    from srt3d_ros.kernels.cuda import phase_sums as on_cuda
    monkeypatch.setattr(on_cuda, "SEGMENT", 2)
    device, continuous = Device("cuda", on_cuda, cuda.array, cuda.numpy), function == "sketch_continuous"
    pixel, toa = draw(2_000, np.float32 if continuous else np.uint16, pixels=4)
    more = ((1, 3), T, False) if continuous else ()
    found = device.sketch(function, pixel, toa, *more, frequencies=(1, 3), pixels=4, table=not continuous)
    expected = expected_of("sketch_continuous", pixel, toa, (1, 3), T, False, frequencies=(1, 3), pixels=4, table=False)
    assert on_cuda._parts(2_000, 4) == 3
    assert_close(found, expected, EACH["cuda"])


def test_photons_add_to_what_is_there(device):
    pixel, toa = draw(300, ordered=True)
    once = device.sketch("sketch_sorted", pixel, toa, frequencies=(1, 3))
    thrice = device.sketch("sketch_sorted", pixel, toa, frequencies=(1, 3), times=3)
    assert np.array_equal(3 * once[2], thrice[2]) and np.array_equal(3 * once[1], thrice[1])


def test_a_sketcher_on_cuda_gives_the_sketch_of_one_on_the_cpu(cuda):
    sensor = SensorModel(4, 10, T, 1e-10, [1, 2, 1], gates=GateWords(first_word=3, no_detection=0))
    sketchers = [Sketcher(sensor, (1, 3, 24), device) for device in ("cpu", "cuda")]
    pixel, toa = draw(400, seed=5)
    frames = [PhotonEvents(*draw(dtype=dtype, ordered=ordered), stamp_ns=40)
              for dtype, ordered in ((np.uint16, True), (np.uint32, False), (np.float32, True), (np.float32, False))]
    frames += [PhotonGates.from_events(PhotonEvents(pixel, toa), sensor), PhotonEvents(pixel[:0], toa[:0])]
    for sketcher in sketchers:
        for frame in frames:
            sketcher.add(frame)
    one, other = (sketcher.sketch() for sketcher in sketchers)
    assert (one.frequencies, one.stamp_ns) == (other.frequencies, other.stamp_ns)
    assert np.array_equal(one.photons, cuda.numpy(other.photons)) and one.photons.sum() == 3_200
    assert (np.abs(one.sums - cuda.numpy(other.sums)) <= EACH["cuda"] * np.maximum(one.photons, 1)[..., None]).all()
    sketchers[1].reset()
    assert not sketchers[1].sketch().sums.any() and not cuda.numpy(sketchers[1].sketch().photons).any()


def test_a_sketcher_on_the_reference_gives_the_sketch_of_one_on_the_cpu():
    sensor = SensorModel(4, 10, T, 1e-10, [1, 2, 1], gates=GateWords(first_word=3, no_detection=0))
    photons = PhotonEvents(*draw(400))
    frames = [photons, PhotonEvents(*draw(dtype=np.float32)), PhotonGates.from_events(photons, sensor)]
    one, other = (Sketcher(sensor, (1, 3, 24), device) for device in ("cpu", "reference"))
    for sketcher in (one, other):
        for frame in frames:
            sketcher.add(frame)
    assert_close((other.sketch().sums.reshape(PIXELS, 3), other.sketch().photons.ravel(), None),
                 (one.sketch().sums.reshape(PIXELS, 3), one.sketch().photons.ravel()), OF_WAVES["cpu"])


def test_photons_that_lie_on_cuda_are_added_as_often_as_asked_for(cuda):
    sensor = SensorModel(4, 10, T, 1e-10, [1, 2, 1])
    sketcher, frame = Sketcher(sensor, (1, 3), "cuda"), PhotonEvents(*draw(ordered=True))
    add = sketcher.resident(frame)
    assert not sketcher.sketch().sums.any()
    add()
    once = cuda.numpy(sketcher.sketch().sums)
    add()
    np.testing.assert_allclose(cuda.numpy(sketcher.sketch().sums), 2 * once, rtol=1e-6)
    assert not hasattr(Sketcher(sensor, (1, 3), "cpu"), "resident")


@pytest.mark.parametrize(("frame", "message"), [
    (PhotonEvents(np.array([0, 40], np.uint32), np.array([1, 2], np.uint16)), "pixel is 40: "),
    (PhotonEvents(np.array([5, 0], np.uint32), np.array([1, 50], np.uint16)), "toa is 50: "),
    (PhotonEvents(np.array([0, 1], np.uint32), np.array([np.nan, 2], np.float32)), "toa is nan: "),
    (PhotonGates(np.full((2, 4, 10), 53, np.uint16)), "gates word is 53: ")])
def test_a_sketcher_on_cuda_names_an_invalid_photon_and_adds_nothing(cuda, frame, message):
    sensor = SensorModel(4, 10, T, 1e-10, [1, 2, 1], gates=GateWords(first_word=3, no_detection=0))
    sketcher = Sketcher(sensor, (1, 3), "cuda")
    with pytest.raises(InvalidInput, match=f"^{message}"):
        sketcher.add(frame)
    assert not sketcher.sketch().sums.any() and not cuda.numpy(sketcher.sketch().photons).any()
