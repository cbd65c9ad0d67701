"""`srt3d reconstruct --method`: every method, its own frequencies, and options that are not for it."""

import json

import numpy as np
import pytest

from srt3d_ros.cli import main
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import npz
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

SENSOR = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2))


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A photon file of a wall at bin 80."""
    path = tmp_path_factory.mktemp("photons") / "wall.npz"
    scene = StaticScene(SENSOR.range_m(np.full((12, 20), 80.0)))
    npz.save(path, SENSOR, Simulator(scene, SENSOR, sbr=10, ppp=60).frame(0)[0])
    return path


@pytest.mark.parametrize("name", METHODS)
def test_every_method_writes_a_cloud_and_says_how(wall, tmp_path, capsys, name):
    out = tmp_path / "cloud.npz"
    assert main.main(["reconstruct", str(wall), "-o", str(out), "--json", "--method", name]) == 0
    facts = json.loads(capsys.readouterr().out)
    sketched = METHODS[name].needs == "sketch"
    assert (facts["method"], facts["sketch_size"]) == (name, 10 if sketched else None)
    assert facts["frequencies"] == (list(choose(METHODS[name].frequencies, SENSOR)) if sketched else [])
    assert (facts["sketch_ms"] is not None) == sketched and facts["reconstruct_ms"] > 0
    with np.load(out) as file:
        assert len(file["row"]) == facts["points"] > 230 and abs(np.median(file["depth_bins"]) - 80) < 0.5
    assert main.main(["reconstruct", str(wall), "-o", str(out), "--method", name]) == 0
    words = capsys.readouterr().out
    assert f"by {name} on cpu" in words and ("sketch of 10" in words) == sketched


def test_weighting_reaches_the_method(wall, tmp_path):
    depths = []
    for weighting in ("identity", "precision"):
        out = tmp_path / f"{weighting}.npz"
        options = ["--method", "smle", "--weighting", weighting]
        assert main.main(["reconstruct", str(wall), "-o", str(out), *options]) == 0
        with np.load(out) as file:
            depths.append(file["depth_bins"])
    assert not np.array_equal(*depths)


@pytest.mark.parametrize(("options", "line"), [
    (["--method", "rt3d", "--weighting", "identity"], "weighting is identity: expected nothing: rt3d takes "),
    (["--method", "xcorr", "--weighting", "precision"], "weighting is precision: expected nothing: xcorr takes "),
    (["--method", "srt3d", "--false-alarm-rate", "0.1"], "false_alarm_rate is 0.1: expected nothing: srt3d takes "),
    (["--method", "xcorr", "--sketch-size", "5"], "sketch_size is 5: expected nothing: xcorr makes no sketch"),
    (["--method", "rt3d", "--frequencies", "auto"], "frequencies is auto: expected nothing: rt3d makes no sketch"),
    (["--method", "xcorr", "--device", "cuda"], "device is cuda: expected cpu or auto: xcorr has no CUDA kernels")])
def test_options_that_are_not_for_a_method_are_one_line(wall, tmp_path, capsys, options, line):
    assert main.main(["reconstruct", str(wall), "-o", str(tmp_path / "a.npz"), *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and printed.err.startswith(f"srt3d: error: {line}")
