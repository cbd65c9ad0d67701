"""`srt3d reconstruct --frames`: the files of --frame N, byte for byte, stopped or not."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from srt3d_ros.cli import main
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import photon_frames
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.messages import sketch as sketches
from tests.bags import CLOUD, IMAGE, TEXT, write_bag
from tests.datasets.made_logs import tmf8829_log, zones_16
from tests.processes import wait

SENSOR = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), gates=GateWords())
FREQUENCIES = (1, 2, 5, 9)
TYPES = {"photons": CLOUD, "sketch": CLOUD, "gates": IMAGE, "histograms": IMAGE}
FRAMES = 6


@pytest.fixture
def reconstruct(capfd):
    """A function of the arguments of `srt3d reconstruct`: exit code, stdout, stderr."""
    def run(*arguments: object) -> tuple[int, str, str]:
        code = main.main(["reconstruct", *map(str, arguments)])
        return code, *capfd.readouterr()

    return run


def events(k: int) -> PhotonEvents:
    """Frame k: a wall at bin 80 + 10 k."""
    depth = np.full((12, 20), 80.0 + 10 * k)
    return Simulator(StaticScene(SENSOR.range_m(depth)), SENSOR, sbr=5, ppp=20, seed=k).frame(0)[0]


def message(kind: str, k: int) -> bytes:
    if kind == "sketch":
        return sketches.encode_cdr(sketch_photons(events(k), SENSOR, FREQUENCIES), SENSOR, "lidar", "coded")
    return photon_frames.encode_cdr(events(k), kind, SENSOR)


def frames_bag(path: Path, kind: str = "photons", broken: tuple[int, ...] = (), frames: int = FRAMES) -> Path:
    """A bag whose frames `broken` are cut off."""
    raws = [message(kind, k % FRAMES) for k in range(frames)]
    described = ("/sketch/sensor" if kind == "sketch" else "/sensor", TEXT, sensor_message.encode_cdr(SENSOR))
    return write_bag(path, [described, *((f"/{kind}", TYPES[kind], raw[:-len(raw) // 2] if k in broken else raw)
                                         for k, raw in enumerate(raws))])


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("kind", TYPES)
def test_the_files_are_those_of_each_frame_by_itself(tmp_path, reconstruct, kind):
    bag = frames_bag(tmp_path / "bag", kind)
    code, out, _ = reconstruct(bag, "--frames", "all", "--out", tmp_path / "all", "--surfaces", 2, "--json")
    assert code == 0
    made, summary = files(tmp_path / "all"), json.loads(out)
    assert list(made) == [f"frame_{k:06d}.npz" for k in range(FRAMES)]
    assert (summary["done"], summary["earlier"], summary["failed"]) == (FRAMES, 0, 0) and summary["points"] > 1000
    for k in (0, 4):
        reconstruct(bag, "--frame", k, "-o", tmp_path / "one.npz", "--surfaces", 2)
        assert made[f"frame_{k:06d}.npz"] == (tmp_path / "one.npz").read_bytes()
    depths = [np.median(np.load(tmp_path / "all" / name)["depth_bins"]) for name in made]
    assert depths == pytest.approx([80 + 10 * k for k in range(FRAMES)], abs=2)


def test_the_frames_of_a_log(tmp_path, reconstruct):
    log = tmf8829_log(tmp_path / "log.json", [zones_16(range_m) for range_m in (2.0, 3.0, 4.0)])
    code, out, _ = reconstruct(log, "--frames", "all", "--out", tmp_path / "all", "--format", "ply")
    assert code == 0 and out.startswith("3 of 3 frames reconstructed")
    made = files(tmp_path / "all")
    assert list(made) == [f"frame_{k:06d}.ply" for k in range(3)]
    reconstruct(log, "--frame", 2, "-o", tmp_path / "one.ply")
    assert made["frame_000002.ply"] == (tmp_path / "one.ply").read_bytes()


def test_frames_that_fail_are_a_line_each_and_the_same_command_tries_only_them_again(tmp_path, reconstruct):
    bag = frames_bag(tmp_path / "bag", broken=(2, 4))
    for earlier in (0, FRAMES - 2):
        code, out, err = reconstruct(bag, "--frames", "all", "--out", tmp_path / "all")
        lines = sorted(line for line in err.splitlines() if line.startswith("srt3d: "))     # beside the progress bar's
        assert code == 1 and len(lines) == 3 and lines[0].startswith(f"srt3d: 2 of {FRAMES} frames failed; ")
        assert lines[1].startswith("srt3d: frame 2: ") and lines[2].startswith("srt3d: frame 4: ")
        assert f"{earlier} were there, 2 failed" in out
        assert len(files(tmp_path / "all")) == FRAMES - 2


def test_a_mistake_in_the_options_ends_the_command_in_one_line(tmp_path, reconstruct):
    bag, folder = frames_bag(tmp_path / "bag"), tmp_path / "all"
    code, out, err = reconstruct(bag, "--frames", "all", "--out", folder, "--method", "magic")
    lines = [line for line in err.splitlines() if line.startswith("srt3d: ")]       # beside the progress bar's
    assert (code, out) == (2, "") and len(lines) == 1 and "error: method is magic" in lines[0] and not files(folder)
    (tmp_path / "file").touch()
    assert "output is" in reconstruct(bag, "--frames", "all", "--out", tmp_path / "file")[2]


@pytest.mark.parametrize(("arguments", "line"), [
    (("--frames", "all", "--frame", "1"), "frame is 1: expected nothing beside --frames"),
    (("--format", "ply"), "format is ply: expected nothing without --frames"),
    (("--frames", "all", "--format", "las"), "frame.las: expected a file name that ends in .npz, ")])
def test_mistakes_are_one_line(tmp_path, reconstruct, arguments, line):
    bag = frames_bag(tmp_path / "bag")
    code, _, err = reconstruct(bag, "--out", tmp_path / "all", *arguments)
    assert code == 2 and line in err and len(err.splitlines()) == 1


def test_a_file_of_one_frame_is_refused(tmp_path, reconstruct):
    np.savez(tmp_path / "one.npz", a=1)
    code, _, err = reconstruct(tmp_path / "one.npz", "--frames", "all", "--out", tmp_path / "all")
    assert code == 2 and "frames is one.npz: expected a bag or log of histograms" in err


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_nothing_is_lost_however_it_ends(tmp_path, reconstruct, how):
    bag, folder = frames_bag(tmp_path / "bag", frames=60), tmp_path / "all"
    command_line = [sys.executable, "-m", "srt3d_ros.cli.main", "reconstruct", bag, "--frames", "all"]
    with subprocess.Popen([*command_line, "--out", folder], stderr=subprocess.PIPE, text=True) as running:
        wait(lambda: len(list(folder.glob("frame*"))) >= 5 or running.poll() is not None, "5 frames")
        running.send_signal(how)
        said = running.stderr.read()
    assert running.returncode == (130 if how == signal.SIGINT else -how) and "Traceback" not in said
    assert 5 <= len(list(folder.glob("frame*"))) < 60
    assert reconstruct(bag, "--frames", "all", "--out", folder)[0] == 0
    assert reconstruct(bag, "--frames", "all", "--out", tmp_path / "here")[0] == 0
    assert {name: raw for name, raw in files(folder).items() if name[0] != "."} == files(tmp_path / "here")
