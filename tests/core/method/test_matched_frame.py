"""What the iterations see of a pixel does not depend on its calibration: delay, gain, mask and IRF are taken out."""

import numpy as np
import pytest

from srt3d_ros.core.method.matched_frame import WEAKEST_PASSBAND, Matcher
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.errors import InvalidInput
from tests.core import scenes

ROWS, COLS, T = 3, 4, 200
FREQUENCIES = (1, 2, 5, 9, 14)
IRF = np.array([0.1, 1.0, 0.8, 0.4, 0.2, 0.1])
RNG = np.random.default_rng(0)
DEPTH = RNG.uniform(0, T, (ROWS, COLS))
SIGNAL = RNG.uniform(5, 50, (ROWS, COLS))


def make(**changes) -> SensorModel:
    return SensorModel(**({"rows": ROWS, "cols": COLS, "num_bins": T, "bin_width_s": 1e-10, "irf": IRF,
                           "irf_ref": 2} | changes))


def exact(sensor: SensorModel) -> PhaseSums:
    return scenes.exact(sensor, DEPTH, SIGNAL, frequencies=FREQUENCIES)


def frame_energy(sensor: SensorModel) -> np.ndarray:
    return (np.abs(np.atleast_2d(irf_spectrum(sensor, FREQUENCIES)))**2).mean(axis=0)


def complex_matched(frame) -> np.ndarray:
    """`matched` as complex numbers [rows, cols, m]."""
    m = len(FREQUENCIES)
    return (frame.matched[:, :m] + 1j * frame.matched[:, m:]).transpose(0, 2, 1)


def test_a_plain_pixel_is_the_signal_times_the_energy_at_its_depth():
    sensor = make()
    frame = scenes.matched_frame(sensor, exact(sensor))
    omega, energy = angular_frequencies(FREQUENCIES, T), frame_energy(sensor)
    expected = SIGNAL[..., None] * energy * np.exp(1j * DEPTH[..., None] * omega)
    np.testing.assert_allclose(complex_matched(frame), expected, atol=1e-4)
    np.testing.assert_allclose(frame.energy, energy, rtol=1e-6)
    np.testing.assert_allclose(frame.bin_frequencies, np.array(FREQUENCIES) / T, rtol=1e-6)
    assert (frame.exposure == 1).all() and np.array_equal(frame.counts, np.rint(SIGNAL))
    assert frame.num_bins == T and frame.shape == (ROWS, COLS)


@pytest.mark.parametrize("changes", [
    {"delay_bins": RNG.uniform(-300, 300, (ROWS, COLS))}, {"gain": RNG.uniform(0.5, 2, (ROWS, COLS))},
    {"irf": np.stack([np.roll(IRF, k % 2) for k in range(ROWS * COLS)]), "gain": RNG.uniform(0.5, 2, (ROWS, COLS)),
     "delay_bins": RNG.uniform(-9, 9, (ROWS, COLS))}], ids=["delay", "gain", "all at once"])
def test_calibration_is_taken_out(changes):
    sensor = make(**changes)
    matched = complex_matched(scenes.matched_frame(sensor, exact(sensor))) / sensor.exposure[..., None]
    expected = SIGNAL[..., None] * frame_energy(sensor) * np.exp(
        1j * DEPTH[..., None] * angular_frequencies(FREQUENCIES, T))
    np.testing.assert_allclose(matched, expected, rtol=1e-4, atol=2e-3)


def test_what_a_pixels_irf_does_not_pass_is_not_blown_up():
    shapes = np.tile(IRF, (ROWS * COLS, 1))
    shapes = np.pad(shapes, ((0, 0), (0, T - len(IRF))))
    shapes[5] = 1                                       # sees every time alike: no signal passes
    sensor = make(irf=shapes)
    noise = PhaseSums(FREQUENCIES, np.full((ROWS, COLS, len(FREQUENCIES)), 10, np.complex64),
                   np.full((ROWS, COLS), 100, np.uint32), sensor=sensor)
    seen = np.abs(complex_matched(scenes.matched_frame(sensor, noise)))
    assert (seen[1, 1] <= 10 * np.sqrt(frame_energy(sensor)) / WEAKEST_PASSBAND).all()


@pytest.mark.parametrize(("sketch", "named"), [
    (noise_sketch(make(), (1, 2, 5, 9, 15)),
     r"sketch frequencies is \[1, 2, 5, 9, 15\]: expected \[1, 2, 5, 9, 14\]"),
    (noise_sketch(make(rows=COLS, cols=ROWS), FREQUENCIES),
     r"sketch size is \(4, 3\): expected rows × cols = \(3, 4\)")])
def test_a_sketch_of_another_sensor_is_refused(sketch, named):
    with pytest.raises(InvalidInput, match=f"^{named}"):
        Matcher(make(), FREQUENCIES).check(sketch)


@pytest.mark.parametrize("photons", [2, 1000])
def test_background_is_no_likelier_to_respond_than_its_rarity_says(photons):
    sensor = make()
    frame = scenes.matched_frame(sensor, exact(sensor))
    u = np.linspace(0, frame.max_response, len(frame.background_table))
    response = (np.exp(1j * np.outer(np.arange(T), angular_frequencies(FREQUENCIES, T)))
                * np.conj(irf_spectrum(sensor, FREQUENCIES))).real.sum(axis=1)
    rng = np.random.default_rng(2)
    means = response[rng.integers(0, T, (20_000, photons))].mean(axis=1)
    for sigmas in (1.0, 2.0, 3.0):
        reached = (np.sqrt(photons) * np.interp(means, u, frame.background_table) >= sigmas).mean()
        bound = np.exp(-sigmas**2 / 2)
        assert reached <= bound + 3 * np.sqrt(bound / 20_000)
