"""SketchDesign: a gate and frequencies that follow the photons, seldom."""

import numpy as np
import pytest

from srt3d_ros.core.frame_watch import LOOK_NS, LOOKS
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch_design import CHANGE_NS, SMALLER, SketchDesign, design_for
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import light_of

T = 500
SENSOR = SensorModel(8, 10, T, 1e-10, [1, 2, 4, 2, 1])


def frame(*depths, stamp_ns=0, seed=0, background=20_000, sensor=SENSOR) -> PhotonEvents:
    """An even background, and 600 photons at each depth."""
    rng = np.random.default_rng(seed)
    pulses = [d + rng.choice(5, 600, p=sensor.irf) - sensor.irf_ref for d in depths]
    toa = np.concatenate([rng.integers(0, T, background), *pulses])
    return PhotonEvents(rng.integers(0, sensor.pixels, len(toa), dtype=np.uint32), toa.astype(np.uint16), stamp_ns)


def follow(design, *depths, seconds=1.0, start_s=0.0) -> list[float]:
    """Show the design frames at 10 Hz; when it changed, in seconds."""
    changes = []
    for k in range(round(10 * seconds)):
        now_s = start_s + k / 10
        shown = frame(*depths, stamp_ns=round(now_s * 1e9), seed=round(10 * now_s))
        design.look(shown)
        if design.end_frame(shown.stamp_ns):
            changes.append(now_s)
    return changes


def test_off_and_a_fixed_gate_stay_as_they_are():
    off, fixed = SketchDesign(SENSOR), SketchDesign(SENSOR, "100:299", "auto", 5)
    assert off.gate is None and off.sensor is SENSOR and off.frequencies == choose("auto", SENSOR)
    assert fixed.sensor.num_bins == 200 and fixed.frequencies == choose("auto", fixed.sensor, 5)
    assert follow(off, 250) == follow(fixed, 400) == [] and str(fixed.gate) == "100:299"


def test_auto_finds_the_scene_in_the_first_frame_and_designs_frequencies_for_it():
    design = design_for(frame(200, 240), SENSOR, "auto")
    assert 170 < design.gate.first <= 196 and 244 <= design.gate.last < 270
    assert design.sensor.range_m(0) == pytest.approx(SENSOR.range_m(design.gate.first))
    assert design.frequencies == choose("auto", design.sensor) != choose("auto", SENSOR)


@pytest.mark.parametrize("depths", [(), (20, 120, 220, 320, 420, 480)], ids=["nothing", "all depths"])
def test_auto_is_no_gate_where_nothing_can_be_gained(depths):
    assert design_for(frame(*depths), SENSOR, "auto").gate is None
    assert design_for(frame(200, background=50), SENSOR, "auto").gate is None      # no background to drop


def test_auto_ends_within_the_sensors_bins():
    assert design_for(frame(3, 9), SENSOR, "auto").gate.first == 0
    assert design_for(frame(496, 480), SENSOR, "auto").gate.last == T - 1


def test_a_gate_has_room_for_the_irf_and_for_the_frequencies():
    wide = SENSOR.replace(irf=np.concatenate([SENSOR.irf, np.zeros(150)]))
    assert design_for(frame(200), wide, "auto").sensor.num_bins >= 155
    assert design_for(frame(200), SENSOR, "auto", "1,2,80").sensor.num_bins >= 161
    assert design_for(frame(200), SENSOR, "auto", "auto", 30).sensor.num_bins >= 61


def test_something_new_outside_opens_the_gate_and_what_is_gone_closes_it():
    design = SketchDesign(SENSOR, "auto")
    assert follow(design, 200, 240, seconds=5) == [0] and design.gate.last < 300
    opened, = follow(design, 200, 240, 400, seconds=5, start_s=5)
    assert opened <= 6 and design.gate.first < 200 and 404 <= design.gate.last
    closed, = follow(design, 200, 240, seconds=10, start_s=10)
    assert closed <= 10 + (LOOKS + 1) * LOOK_NS / 1e9 and design.gate.last < 300


def test_photons_that_show_nothing_open_the_gate():
    design = SketchDesign(SENSOR, "auto")
    follow(design, 200)
    assert design.gate is not None and follow(design, seconds=8, start_s=1) and design.gate is None


def test_a_scene_that_moves_within_the_gate_changes_nothing():
    design = SketchDesign(SENSOR, "auto")
    follow(design, 200, 260)
    before = str(design.gate)
    for k in range(10):
        assert follow(design, 200 + k % 3, 260 - k % 4, start_s=1 + k) == []
    assert str(design.gate) == before


def test_a_smaller_gate_comes_only_where_it_is_much_smaller():
    for far, changes in ((320, 0), (240, 1)):
        design = SketchDesign(SENSOR, "auto")
        follow(design, 200, 340)
        length = design.gate.num_bins
        assert len(follow(design, 200, far, seconds=6, start_s=1)) == changes
        assert changes == 0 or design.gate.num_bins <= SMALLER * length


def test_changes_are_seldom_and_the_first_comes_at_once():
    design, changes = SketchDesign(SENSOR, "auto"), []
    for k in range(40):         # a scene that leaps about
        changes += follow(design, 60 + 110 * (k % 4), start_s=k)
    apart = np.diff(changes)
    assert changes[0] == 0 and len(changes) > 5 and apart.min() >= CHANGE_NS / 1e9 - 1e-9


@pytest.mark.parametrize(("settings", "line"), [
    (("open",), "gate is open: expected off, auto, or first and last bin such as 100:400"),
    (("-3:50",), "gate is -3:50: expected first and last within the sensor's bins, 0 to 499"),
    (("300:300",), "gate is 300:300: expected a first bin below the last"),
    (("300:302",), "gate is 300:302: expected 5 bins or more, as many as the IRF has"),
    (("300:309", "auto", 10), "sketch_size is 10: expected 1 to 4 for T = 10 bins"),
    (("300:399", "1,60"), "frequencies is 60: expected integers from 1 to 49 (T = 100 bins; higher ones repeat these)"),
])
def test_a_gate_that_cannot_be_used_is_one_line(settings, line):
    with pytest.raises(InvalidInput) as error:
        SketchDesign(SENSOR, *settings)
    assert str(error.value) == line


# ---- Frequencies that follow the light

BINS = np.arange(160)
EDGE = SensorModel(40, 40, T, 1e-10, np.exp(-BINS / 40) + 4 * np.exp(-0.5 * ((BINS - 5) / 2)**2))


def lit(ppp: float, stamp_s: float = 0.0, sbr: float = 2.0, sensor=EDGE) -> PhotonEvents:
    """Photons of a scene 100 bins deep."""
    depth = np.linspace(150, 250, sensor.pixels).reshape(1, sensor.rows, sensor.cols)
    scene = StaticScene(sensor.range_m(depth), np.ones_like(depth))
    events, _ = Simulator(scene, sensor, sbr=sbr, ppp=ppp, seed=round(stamp_s * 10)).frame(0)
    return PhotonEvents(events.pixel, events.toa, round(stamp_s * 1e9))


def changes(design, ppp, seconds=4.0, start_s=0.0) -> list[float]:
    """Show the design frames at 4 Hz of ppp(t) photons per pixel; when it changed, in seconds."""
    found = []
    for now_s in start_s + np.arange(0, seconds, 0.25):
        shown = lit(ppp(now_s), now_s)
        design.look(shown)
        if design.end_frame(shown.stamp_ns):
            found.append(float(now_s))
    return found


def test_the_first_frame_with_many_photons_takes_frequencies_up():
    design = SketchDesign(EDGE)
    few = design.frequencies
    assert design.light is None and few == choose("auto", EDGE)
    assert changes(SketchDesign(EDGE), lambda t: 1) == []
    assert changes(design, lambda t: 100) == [0]
    assert design.light.photons_per_pixel == pytest.approx(100, rel=0.05)
    assert design.frequencies[-1] > 1.3 * few[-1] and design.sensor is EDGE
    assert design.frequencies == choose("auto", EDGE, None, light_of(lit(100), EDGE))


def test_frequencies_follow_the_light_down_again():
    design = SketchDesign(EDGE)
    assert changes(design, lambda t: 100 if t < 3 else 2, seconds=7) == [0, 4]
    assert design.frequencies == choose("auto", EDGE)


def test_a_frame_that_is_forgotten_is_not_measured():
    design = SketchDesign(EDGE)
    design.look(lit(100))
    design.forget()
    assert not design.end_frame(0) and design.light is None


@pytest.mark.parametrize(("frequencies", "size"), [("spread", 6), ("1,2,5", None)])
def test_frequencies_that_are_not_auto_stay(frequencies, size):
    design = SketchDesign(EDGE, frequencies=frequencies, sketch_size=size)
    assert changes(design, lambda t: 100, seconds=1) == [] and design.light is None
    assert design.frequencies == choose(frequencies, EDGE, size)


def test_the_photons_of_a_window_count_together():
    design = SketchDesign(EDGE, window_frames=16)
    assert changes(design, lambda t: 30, seconds=0.25) == [0]
    light = light_of(lit(30), EDGE)
    assert design.light == light.of_frames(16)
    assert design.frequencies == choose("auto", EDGE, None, design.light) != choose("auto", EDGE, None, light)


def test_a_gate_and_the_light_change_together():
    design = design_for(lit(400, sbr=1), EDGE, "auto")
    light = light_of(lit(400, sbr=1), EDGE).gated(design.sensor.num_bins / T)
    assert 100 < design.sensor.num_bins < 400
    assert design.frequencies == choose("auto", design.sensor, None, light) != choose("auto", design.sensor)
