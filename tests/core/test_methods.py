"""The table of methods: names, what each needs and takes, and one way to run them all."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import (
    DEFAULT_METHOD,
    METHODS,
    OLD_NAMES,
    SKETCH_METHODS,
    find,
    reconstruct,
    refuse_old_name,
)
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(12, 14, 300, 1e-10, np.exp(-np.linspace(-2, 3, 21)**2))
DEPTH = np.full((12, 14), 120.0)


def test_all_methods_of_the_paper_are_there():
    assert set(METHODS) == {"pooled", "srt3d", "smle", "xcorr", "rt3d"}
    assert DEFAULT_METHOD == "pooled" and set(SKETCH_METHODS) == {"pooled", "srt3d", "smle"}
    assert {name for name in METHODS if METHODS[name].frequencies == "consecutive"} == {"srt3d", "smle"}


@pytest.mark.parametrize("name", METHODS)
def test_every_method_finds_a_wall(name):
    frame, _ = Simulator(StaticScene(SENSOR.range_m(DEPTH)), SENSOR, sbr=10, ppp=30).frame(0)
    frequencies = choose(METHODS[name].frequencies, SENSOR, 6)
    cloud = reconstruct(name, frame, SENSOR, frequencies)
    assert len(cloud) >= 0.95 * DEPTH.size
    assert np.abs(np.median(cloud.depth_bins) - 120) < 0.5


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("option", ["false_alarm_rate", "weighting", "upsampling", "sharpness"])
def test_options_that_a_method_does_not_take_are_named(name, option):
    method = METHODS[name]
    if option in method.options:
        return
    with pytest.raises(InvalidInput, match=f"^{option} is 0.1: expected nothing: {name} takes surfaces, device"):
        method.build(SENSOR, (1, 2, 3), **{option: 0.1})


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(("option", "value"), [("surfaces", 0), ("surfaces", 5), ("surfaces", 1.5), ("surfaces", "2"),
                                               ("device", "gpu"), ("device", "cuda"), ("false_alarm_rate", 0.0),
                                               ("false_alarm_rate", 1.0), ("false_alarm_rate", float("nan")),
                                               ("weighting", "none")])
def test_values_that_cannot_be_used_are_named(name, option, value):
    with pytest.raises(InvalidInput, match=f"^{option} is {value}"):
        METHODS[name].build(SENSOR, (1, 2, 3), **{option: value})


@pytest.mark.parametrize("name", METHODS)
def test_every_method_tells_its_device_and_can_warm_up(name):
    method = METHODS[name].build(SENSOR, (1, 2, 3), surfaces=2)
    method.warm_up()
    assert method.device == "cpu"


def test_an_unknown_method_is_named_with_the_known_ones():
    with pytest.raises(InvalidInput, match="^method is magic: expected pooled or srt3d or smle or xcorr or rt3d$"):
        find("magic")


def test_an_old_name_is_refused_with_the_new_one():
    for name in OLD_NAMES:
        assert name not in METHODS
    line = "method is srt3d-paper: expected its new name, srt3d (SRT3D as published)"
    with pytest.raises(InvalidInput) as caught:
        find("srt3d-paper")
    assert str(caught.value) == line
    with pytest.raises(InvalidInput) as caught:
        refuse_old_name("srt3d-paper")
    assert str(caught.value) == line
