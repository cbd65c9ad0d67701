"""The gate and the frequencies for a sensor, or for the photons of a frame."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import design_for, fixed_design
from srt3d_ros.core.sketching.frequencies import choose
from srt3d_ros.core.sketching.light import light_of
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import simulate

T = 500
SENSOR = SensorModel(8, 10, T, 1e-10, [1, 2, 4, 2, 1])


def frame(*depths, stamp_ns=0, seed=0, background=20_000, sensor=SENSOR) -> PhotonEvents:
    """An even background, and 600 photons at each depth."""
    rng = np.random.default_rng(seed)
    pulses = [d + rng.choice(5, 600, p=sensor.irf) - sensor.irf_ref for d in depths]
    toa = np.concatenate([rng.integers(0, T, background), *pulses])
    return PhotonEvents(rng.integers(0, sensor.pixels, len(toa), dtype=np.uint32), toa.astype(np.uint16), stamp_ns)


def test_a_fixed_design_is_of_the_sensor_alone():
    gate, frequencies, light = fixed_design(SENSOR)
    assert gate is None and light is None and frequencies == choose("auto", SENSOR)
    gate, frequencies, _ = fixed_design(SENSOR, "100:299", "auto", 5)
    assert gate.sensor.num_bins == 200 and frequencies == choose("auto", gate.sensor, 5)
    assert design_for(frame(400), SENSOR, "100:299", "spread", 5).frequencies == choose("spread", gate.sensor, 5)


def test_auto_finds_the_scene_in_the_first_frame_and_designs_frequencies_for_it():
    design = design_for(frame(200, 240), SENSOR, "auto")
    assert 170 < design.gate.first <= 196 and 244 <= design.gate.last < 270
    assert design.gate.sensor.range_m(0) == pytest.approx(SENSOR.range_m(design.gate.first))
    assert design.frequencies == choose("auto", design.gate.sensor) != choose("auto", SENSOR)


@pytest.mark.parametrize("depths", [(), (20, 120, 220, 320, 420, 480)], ids=["nothing", "all depths"])
def test_auto_is_no_gate_where_nothing_can_be_gained(depths):
    assert design_for(frame(*depths), SENSOR, "auto").gate is None
    assert design_for(frame(200, background=50), SENSOR, "auto").gate is None      # no background to drop


def test_auto_ends_within_the_sensors_bins():
    assert design_for(frame(3, 9), SENSOR, "auto").gate.first == 0
    assert design_for(frame(496, 480), SENSOR, "auto").gate.last == T - 1


def test_a_gate_has_room_for_the_irf_and_for_the_frequencies():
    wide = SENSOR.replace(irf=np.concatenate([SENSOR.irf, np.zeros(150)]))
    assert design_for(frame(200), wide, "auto").gate.num_bins >= 155
    assert design_for(frame(200), SENSOR, "auto", "1,2,80").gate.num_bins >= 161
    assert design_for(frame(200), SENSOR, "auto", "auto", 30).gate.num_bins >= 61


@pytest.mark.parametrize(("settings", "line"), [
    (("open",), "gate is open: expected off, first and last bin such as 100-400, or for a file auto"),
    (("-3:50",), "gate is -3-50: expected first and last within the sensor's bins, 0 to 499"),
    (("300:300",), "gate is 300-300: expected a first bin below the last"),
    (("300:302",), "gate is 300-302: expected 5 bins or more, as many as the IRF has"),
    (("300:309", "auto", 10), "sketch_size is 10: expected 1 to 4 for T = 10 bins"),
    (("300:399", "1,60"), "frequencies is 60: expected integers from 1 to 49 (T = 100 bins; higher ones repeat these)"),
])
def test_a_gate_that_cannot_be_used_is_one_line(settings, line):
    with pytest.raises(InvalidInput) as error:
        fixed_design(SENSOR, *settings)
    assert str(error.value) == line


# ---- Frequencies for the light

BINS = np.arange(160)
EDGE = SensorModel(40, 40, T, 1e-10, np.exp(-BINS / 40) + 4 * np.exp(-0.5 * ((BINS - 5) / 2)**2))


def lit(ppp: float, sbr: float = 2.0) -> PhotonEvents:
    """Photons of a scene 100 bins deep."""
    return simulate(np.linspace(150, 250, EDGE.pixels).reshape(EDGE.rows, EDGE.cols), sbr, ppp, EDGE)


def test_many_photons_take_frequencies_up():
    few = fixed_design(EDGE).frequencies
    assert design_for(lit(1), EDGE).frequencies == few
    design = design_for(lit(100), EDGE)
    assert design.light.photons_per_pixel == pytest.approx(100, rel=0.05)
    assert design.frequencies[-1] > 1.3 * few[-1]
    assert design.frequencies == choose("auto", EDGE, None, light_of(lit(100), EDGE))


@pytest.mark.parametrize(("frequencies", "size"), [("spread", 6), ("1,2,5", None)])
def test_frequencies_that_are_not_auto_need_no_light(frequencies, size):
    design = design_for(lit(100), EDGE, "off", frequencies, size)
    assert design.light is None and design.frequencies == choose(frequencies, EDGE, size)


def test_a_gate_and_frequencies_for_the_light_in_it():
    design = design_for(lit(400, sbr=1), EDGE, "auto")
    light = light_of(lit(400, sbr=1), EDGE).gated(design.gate.num_bins / T)
    assert 100 < design.gate.num_bins < 400
    assert design.frequencies == choose("auto", design.gate.sensor, None, light) != choose("auto", design.gate.sensor)
