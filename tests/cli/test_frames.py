"""`srt3d reconstruct --frames`: each frame into a file, as it is alone."""

import json
import os
from itertools import islice

import numpy as np
import pytest

from srt3d_ros import datasets
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import photon_frames, sensor_message
from tests.bags import CLOUD, TEXT, write_bag
from tests.datasets.made_logs import tmf8829_log, zones_16

SENSOR = SensorModel(8, 10, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2))
FRAMES, BROKEN = 6, 2


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag of six frames, of which the third is cut off."""
    simulator = Simulator(StaticScene(SENSOR.range_m(np.full((1, 8, 10), 80.0))), SENSOR, sbr=10, ppp=60)
    raws = [photon_frames.PHOTONS.encode_cdr(simulator.frame(k)[0], SENSOR, "") for k in range(FRAMES)]
    raws[BROKEN] = raws[BROKEN][:900]
    return write_bag(tmp_path_factory.mktemp("many") / "bag", [
        ("/sensor", TEXT, sensor_message.encode_cdr(SENSOR)), *(("/photons", CLOUD, raw) for raw in raws)])


def test_every_frame_is_as_it_is_alone_a_broken_one_is_listed_and_a_second_run_replaces_none(bag, srt3d, tmp_path):
    command = ["reconstruct", bag, "-o", tmp_path / "out", "--surfaces=2"]
    code, out, err = srt3d(*command, "--frames", f"{BROKEN - 1}-{FRAMES - 1}", "--json")
    facts = json.loads(out)
    assert (code, facts["frames"], facts["reconstructed"]) == (1, 5, 4)
    assert list(facts["failed"]) == [str(BROKEN)] and f"srt3d: frame {BROKEN}: {facts['failed'][str(BROKEN)]}\n" in err
    assert "cut off" in err
    written = {path.name: path for path in (tmp_path / "out").iterdir()}
    assert sorted(written) == ["000001.npz", "000003.npz", "000004.npz", "000005.npz"]
    for k in (1, 3, 5):
        alone = tmp_path / f"{k}.npz"
        assert srt3d("reconstruct", bag, "--frame", k, "-o", alone, "--surfaces=2")[0] == 0
        assert alone.read_bytes() == written[f"{k:06d}.npz"].read_bytes()
    code, _, err = srt3d(*command, "--frames=all")
    assert code == 2 and "out has 4 of these files: give another folder, or other --frames." in err
    assert srt3d(*command, "--frames=0-0")[0] == 0 and (tmp_path / "out" / "000000.npz").exists()


def test_a_log_has_frames_and_fails_from_where_it_breaks_off(srt3d, tmp_path, monkeypatch):
    log = tmp_path / "log.json"
    tmf8829_log(log, [zones_16(1.0), zones_16(2.0), {}])
    code, out, _ = srt3d("reconstruct", log, "--frames=all", "-o", tmp_path / "a", "--format=ply", "--json")
    assert (code, json.loads(out)["reconstructed"], list(json.loads(out)["failed"])) == (1, 2, ["2"])
    assert sorted(os.listdir(tmp_path / "a")) == ["000000.ply", "000001.ply"]

    def two(*arguments, read=datasets.frame_loaders, **options):
        yield from islice(read(*arguments, **options), 2)
        raise InvalidInput("log", problem="The log breaks off.")

    monkeypatch.setattr(datasets, "frame_loaders", two)
    code, out, err = srt3d("reconstruct", log, "--frames=all", "-o", tmp_path / "b")
    assert (code, err.splitlines()[-1]) == (1, "srt3d: frame 2 to 2: The log breaks off.")
    assert out.startswith("2 of 3 frames reconstructed\n")


@pytest.mark.parametrize(("options", "said"), [
    (["--frames=4-6"], "has no frames 4 to 6 (it has 6)."), (["--frames=3"], "--frames is 3: expected all, or first"),
    (["--frames=all", "-o", "file"], "Cannot write file (File exists)"),
    (["--frames=all", "-o", "out.ply"], "out.ply: expected the name of a folder"),
    (["--frames=all", "-o", "absent/out"], "Cannot write absent/out (No such file or directory)"),
    (["--frames=all", "--surfaces=9"], "--surfaces is 9"),
    (["--frames=all", "--format=obj"], "output is 0.obj"), (["--frames=all", "-o", "mixed"], "mixed has 1 of"),
    (["--frames=all", "--frame=2"], "--frame is 2: expected none beside --frames"),
    (["--format=ply"], "--format needs --frames"), (["--frames=0-10000000"], "Give at most 10,000,000 frames at once."),
    (["--frames=all", "-o", "BAG"], "it is the input")])
def test_a_mistake_is_one_line_and_leaves_no_cloud(bag, refusal, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "mixed").mkdir()
    (tmp_path / "mixed" / "000000.npz").touch()
    options = [str(bag) if word == "BAG" else word for word in options]
    assert said in refusal("reconstruct", bag, "-o", "out", *options)
    assert not list(tmp_path.glob("out/*.npz"))
