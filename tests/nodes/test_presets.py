"""The parameter files for kinds of sensors: what they set exists and may be set."""

from pathlib import Path

import pytest
import yaml

from srt3d_ros.datasets import open_sensor
from srt3d_ros.nodes import all_specs

REPOSITORY = Path(__file__).resolve().parents[2]
PRESETS = sorted(path for path in (REPOSITORY / "config").glob("*.yaml") if path.stem != "srt3d")
MESSAGE_MB = 32         # of `photons`, `gates` or `sketch`: what the shared memory between two nodes is made for


@pytest.fixture(params=PRESETS, ids=lambda path: path.stem)
def preset(request) -> Path:
    return request.param


def settings(preset: Path) -> dict[str, dict]:
    """The values that a file sets, by node."""
    return {key.removeprefix("/**/"): content["ros__parameters"]
            for key, content in yaml.safe_load(preset.read_text()).items()}


def test_every_value_is_of_a_parameter_that_takes_it(preset):
    for node, values in settings(preset).items():
        table = {parameter.name: parameter for parameter in all_specs()[node].table}
        for name, value in values.items():
            assert table[name].check(value) == value


def test_a_sensor_of_the_same_name_is_described(preset):
    sensor = open_sensor(preset.with_name("sensors") / f"{preset.stem}.json")
    rows, cols = map(int, preset.stem.split("_")[1].split("x"))
    assert (sensor.rows, sensor.cols) == (rows, cols)
    assert (sensor.gates is not None) == preset.stem.endswith("gates")
    assert f"T = {sensor.num_bins} " in preset.read_text().splitlines()[0] + preset.read_text().splitlines()[1]
    sketcher = settings(preset)["sketcher"]
    numbers = 2 * sketcher["sketch_size"]
    assert sensor.pixels * (4 + numbers * (2 if sketcher.get("layout") == "int16" else 4)) < MESSAGE_MB * 2**20
