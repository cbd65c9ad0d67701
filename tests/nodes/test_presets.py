"""The parameter files for kinds of sensors: what they set exists and may be set, and the sensor is described."""

from pathlib import Path

import pytest
import yaml

from srt3d_ros.datasets import open_sensor
from srt3d_ros.nodes import all_specs

CONFIG = Path(__file__).resolve().parents[2] / "config"
PRESETS = [path for path in sorted(CONFIG.glob("*.yaml")) if path.stem != "srt3d"]
MESSAGE_MB = 32         # of `photons`, `gates` or `sketch`: what the shared memory between two nodes is made for


@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_values_are_of_parameters_that_take_them_and_suit_the_sensor_of_the_same_name(preset):
    settings = {key.removeprefix("/**/"): content["ros__parameters"]
                for key, content in yaml.safe_load(preset.read_text()).items()}
    for node, values in settings.items():
        table = {parameter.name: parameter for parameter in all_specs()[node].table}
        assert all(table[name].check(value) == value for name, value in values.items())
    sensor, sketcher = open_sensor(preset.with_name("sensors") / f"{preset.stem}.json"), settings["sketcher"]
    assert preset.stem.split("_")[1] == f"{sensor.rows}x{sensor.cols}"
    assert (sensor.gates is not None) == preset.stem.endswith("gates")
    number_bytes = 2 if sketcher.get("layout") == "int16" else 4
    assert sensor.pixels * (4 + 2 * sketcher["sketch_size"] * number_bytes) < MESSAGE_MB * 2**20
