"""`srt3d reconstruct`: a photon file becomes a cloud file; a mistake becomes one line and exit code 2."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from srt3d_ros.cli import main
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets import npz
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message

SENSOR = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), toa_offset_bins=1_000)
DEPTH = np.stack([np.full((12, 20), 80.0), np.full((12, 20), 200.0)])
PROMISED = {"method", "device", "rows", "cols", "num_bins", "photons", "sketch_size", "points", "sketch_ms",
            "reconstruct_ms"}


@pytest.fixture(scope="module")
def photons(tmp_path_factory):
    """A photon file of two layers, and its events."""
    path = tmp_path_factory.mktemp("photons") / "layers.npz"
    events, truth = Simulator(StaticScene(SENSOR.range_m(DEPTH)), SENSOR, sbr=10, ppp=60).frame(0)
    npz.save(path, SENSOR, events, truth)
    return path, events


@pytest.fixture
def run(photons, tmp_path, capsys):
    """Reconstruct into a file; returns exit code, facts of --json, and the file."""
    def call(*options, out="cloud.npz"):
        code = main.main(["reconstruct", str(photons[0]), "-o", str(tmp_path / out), "--json", *options])
        printed = capsys.readouterr()
        assert printed.out.count("\n") == 1 and (printed.err == "" or "--gate" in options)
        return code, json.loads(printed.out), tmp_path / out
    return call


def test_json_is_one_line_that_says_what_was_done(run, photons):
    code, facts, out = run()
    assert code == 0 and facts.keys() >= PROMISED
    expected = {"method": "pooled", "device": "cpu", "rows": 12, "cols": 20, "num_bins": 300, "sketch_size": 10,
                "photons": photons[1].photons}
    assert {name: facts[name] for name in expected} == expected
    assert facts["points"] == len(np.load(out)["row"]) == 240
    assert facts["sketch_ms"] > 0 and facts["reconstruct_ms"] > 0


def test_npz_holds_what_was_promised(run):
    _, facts, out = run("--surfaces", "2")
    with np.load(out, allow_pickle=False) as file:
        n = facts["points"]
        assert n > 400
        shapes = {"row": (n,), "col": (n,), "depth_bins": (n,), "intensity": (n,), "depth_std_bins": (n,),
                  "xyz": (n, 3), "background": (12, 20), "frequencies": (10,)}
        assert {name: file[name].shape for name in shapes} == shapes
        types = {"row": np.uint16, "col": np.uint16, "depth_bins": np.float32, "intensity": np.float32,
                 "depth_std_bins": np.float32, "xyz": np.float32, "background": np.float32}
        assert {name: file[name].dtype for name in types} == types
        assert file["frequencies"].tolist() == facts["frequencies"]


def test_upsampling_writes_a_cloud_of_finer_pixels(run):
    code, facts, out = run("--upsampling", "3")
    assert code == 0 and (facts["rows"], facts["upsampling"], facts["points"]) == (12, 3, 9 * 240)
    with np.load(out) as file:
        assert file["background"].shape == (36, 60)
        rays = SENSOR.upsampled(3).rays[file["row"], file["col"]]
        np.testing.assert_allclose(file["xyz"], rays * SENSOR.range_m(file["depth_bins"])[:, None], rtol=1e-5)


def test_it_is_the_reconstruction_of_the_library(run, photons):
    _, _, out = run()
    frequencies = choose("auto", SENSOR)
    cloud = Pooled(SENSOR, frequencies)(sketch_photons(photons[1], SENSOR, frequencies))
    with np.load(out) as file:
        for name in ("row", "col", "depth_bins", "intensity", "xyz", "background"):
            np.testing.assert_allclose(file[name], getattr(cloud, name), rtol=1e-5, err_msg=name)


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".pcd", ".rrd", ".PLY"])
def test_every_format_is_written(run, suffix):
    code, facts, out = run(out="cloud" + suffix)
    assert code == 0 and facts["output"] == str(out)
    magic = {".npz": b"PK", ".ply": b"ply\n", ".pcd": b"# .PCD", ".rrd": b"RRF"}[suffix.lower()]
    assert out.read_bytes().startswith(magic) and out.stat().st_size > 240 * 16


@pytest.mark.parametrize(("options", "expected"), [
    ((), choose("auto", SENSOR)), (("--frequencies", "auto", "--sketch-size", "6"), choose("auto", SENSOR, 6)),
    (("--frequencies", "consecutive"), tuple(range(1, 11))),
    (("--frequencies", "consecutive", "--sketch-size", "4"), (1, 2, 3, 4)), (("--sketch-size", "1"), (1,)),
    (("--frequencies", "1,2,5,9"), (1, 2, 5, 9)), (("--frequencies", "9,2", "--sketch-size", "2"), (9, 2))])
def test_frequencies_are_the_ones_asked_for(run, options, expected):
    _, facts, out = run(*options)
    assert facts["frequencies"] == list(expected) and facts["sketch_size"] == len(expected)
    assert np.load(out)["frequencies"].tolist() == list(expected)


def test_surfaces_and_false_alarm_rate_reach_the_method(run, monkeypatch):
    seen = {}
    monkeypatch.setattr(Pooled, "__init__", recording(Pooled.__init__, seen))
    run("--surfaces", "2", "--false-alarm-rate", "0.03", "--device", "cpu")
    assert {name: seen[name] for name in ("surfaces", "false_alarm_rate", "device")} == {
        "surfaces": 2, "false_alarm_rate": 0.03, "device": "cpu"}


def test_a_dark_frame_tells_the_background(run, tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr(Pooled, "__init__", recording(Pooled.__init__, seen))
    toa = np.repeat(np.arange(300), np.arange(300)).astype(np.uint16)           # a ramp
    npz.save(tmp_path / "dark.npz", SENSOR, PhotonEvents(np.arange(len(toa), dtype=np.uint32) % 240, toa))
    code, _, out = run("--dark", str(tmp_path / "dark.npz"))
    assert code == 0 and len(np.load(out)["row"]) == 240
    run("--background", "estimate")
    assert seen["background"] == "estimate"


def test_a_dark_frame_of_another_sensor_is_refused(photons, tmp_path, capsys):
    dark, out = str(tmp_path / "dark.npz"), str(tmp_path / "a.npz")
    npz.save(dark, SENSOR.replace(rows=20, cols=12), PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))
    assert main.main(["reconstruct", str(photons[0]), "-o", out, "--dark", dark]) == 2
    assert capsys.readouterr().err == "srt3d: error: dark frame rows is 20: expected 12, as in the input\n"


def recording(function, seen: dict):
    """The function, which notes the keywords of its first call."""
    def wrapped(*args, **keywords):
        seen.update({name: value for name, value in keywords.items() if name not in seen})
        return function(*args, **keywords)
    return wrapped


def test_what_the_file_does_not_say_can_be_given(run):
    _, facts, out = run("--bin-width-s", "1e-10", "--fov-deg", "20", "--num-bins", "400", "--irf-ref", "0")
    with np.load(out) as file:
        assert (facts["num_bins"], file["bin_width_s"], file["irf_ref"]) == (400, 1e-10, 0)


def test_a_frame_of_a_bag_is_reconstructed_as_from_a_file(photons, run, tmp_path):
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/left/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/right/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer()])
    few = PhotonEvents(np.zeros(5, np.uint32), np.arange(5, dtype=np.uint16))
    writer.write("/sensor", 0, sensor_message.encode_cdr(SENSOR))
    for k, (side, frame) in enumerate((("left", few), ("right", few), ("left", photons[1]))):
        writer.write(f"/{side}/photons", k + 1, photons_message.encode_cdr(frame, SENSOR, "lidar"))
    writer.close()
    _, from_file, _ = run()
    assert main.main(["reconstruct", str(tmp_path / "bag"), "-o", str(tmp_path / "b.npz"), "--frame", "1",
                      "--photons-topic", "/left/photons"]) == 0
    with np.load(tmp_path / "cloud.npz") as file, np.load(tmp_path / "b.npz") as bag:
        assert np.array_equal(file["xyz"], bag["xyz"]) and len(file["xyz"]) == from_file["points"]


def test_a_gate_cuts_the_period(run):
    _, facts, out = run("--gate", "50,100")
    assert facts["num_bins"] == 100
    assert np.median(np.load(out)["depth_bins"]) == pytest.approx(80 - 50, abs=0.5)


def test_without_json_it_says_the_same_in_words(photons, tmp_path, capsys):
    assert main.main(["reconstruct", str(photons[0]), "-o", str(tmp_path / "a.npz")]) == 0
    printed = capsys.readouterr()
    assert "12 × 20 pixels" in printed.out and "240 points" in printed.out and str(tmp_path / "a.npz") in printed.out


BAD = {
    "missing file": (["absent.npz", "-o", "a.npz"], "absent.npz"),
    "a folder that is no bag": ([".", "-o", "a.npz"], "bag is ., without metadata.yaml"),
    "no such frame": (["FILE", "-o", "a.npz", "--frame", "1"], "frame is 1"),
    "unknown input": (["notes.txt", "-o", "a.npz"], "notes.txt"),
    "broken input": (["broken.npz", "-o", "a.npz"], "broken.npz"),
    "wrong suffix": (["FILE", "-o", "cloud.las"], "output is cloud.las"),
    "no suffix": (["FILE", "-o", "cloud"], "output is cloud"),
    "folder as output": (["FILE", "-o", "folder.npz"], "output is folder.npz"),
    "output in no folder": (["FILE", "-o", "absent/a.npz"], "output is absent/a.npz"),
    "no output": (["FILE"], "-o"),
    "0 surfaces": (["FILE", "-o", "a.npz", "--surfaces", "0"], "surfaces is 0"),
    "5 surfaces": (["FILE", "-o", "a.npz", "--surfaces", "5"], "surfaces is 5"),
    "surfaces in words": (["FILE", "-o", "a.npz", "--surfaces", "two"], "--surfaces"),
    "rate 0": (["FILE", "-o", "a.npz", "--false-alarm-rate", "0"], "false_alarm_rate is 0"),
    "rate 2": (["FILE", "-o", "a.npz", "--false-alarm-rate", "2"], "false_alarm_rate is 2"),
    "rate nan": (["FILE", "-o", "a.npz", "--false-alarm-rate", "nan"], "false_alarm_rate is nan"),
    "rate in words": (["FILE", "-o", "a.npz", "--false-alarm-rate", "low"], "--false-alarm-rate"),
    "device cuda": (["FILE", "-o", "a.npz", "--device", "cuda"], "device is cuda"),
    "device gpu": (["FILE", "-o", "a.npz", "--device", "gpu"], "--device"),
    "other method": (["FILE", "-o", "a.npz", "--method", "magic"], "method is magic"),
    "old name": (["FILE", "-o", "a.npz", "--method", "srt3d-paper"], "method is srt3d-paper: expected its new name, "),
    "sketch size 0": (["FILE", "-o", "a.npz", "--sketch-size", "0"], "sketch_size is 0"),
    "sketch size 1000": (["FILE", "-o", "a.npz", "--sketch-size", "1000"], "sketch_size is 1000"),
    "sketch size and list": (["FILE", "-o", "a.npz", "--sketch-size", "3", "--frequencies", "1,2"], "sketch_size is 3"),
    "frequencies in words": (["FILE", "-o", "a.npz", "--frequencies", "low"], "frequencies is low"),
    "frequency 0": (["FILE", "-o", "a.npz", "--frequencies", "0,1"], "frequencies is 0"),
    "frequency twice": (["FILE", "-o", "a.npz", "--frequencies", "2,2"], "frequencies is [2, 2]"),
    "frequency too high": (["FILE", "-o", "a.npz", "--frequencies", "1,150"], "frequencies is 150"),
    "gate of one number": (["FILE", "-o", "a.npz", "--gate", "5"], "--gate"),
    "gate outside": (["FILE", "-o", "a.npz", "--gate", "250,100"], "gate"),
    "missing IRF": (["FILE", "-o", "a.npz", "--irf", "absent.npy"], "irf is absent.npy"),
    "bin width 0": (["FILE", "-o", "a.npz", "--bin-width-s", "0"], "bin_width_s is 0"),
    "too few bins for the photons": (["FILE", "-o", "a.npz", "--num-bins", "100"], "toa is"),
    "other background": (["FILE", "-o", "a.npz", "--background", "dark"], "--background"),
    "missing dark frame": (["FILE", "-o", "a.npz", "--dark", "absent.npz"], "absent.npz"),
    "dark frame and flat": (["FILE", "-o", "a.npz", "--dark", "FILE", "--background", "flat"], "background is flat"),
    "dark frame of another method": (["FILE", "-o", "a.npz", "--dark", "FILE", "--method", "xcorr"], "dark is"),
    "control characters": (["\x1b[2Jno\nfile.npz", "-o", "a.npz"], "\\x1b[2Jno file.npz"),
}


@pytest.mark.parametrize(("arguments", "named"), BAD.values(), ids=BAD)
def test_a_mistake_is_one_line_and_exit_code_2(photons, tmp_path, monkeypatch, capsys, arguments, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "notes.txt").write_text("no photons")
    (tmp_path / "broken.npz").write_bytes(photons[0].read_bytes()[:500])
    before = sorted(tmp_path.iterdir())
    try:
        code = main.main(["reconstruct", *(str(photons[0]) if word == "FILE" else word for word in arguments)])
    except SystemExit as stopped:
        code = stopped.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert printed.err.startswith("srt3d: error: ") and printed.err.count("\n") == 1 and named in printed.err
    assert printed.err[:-1].isprintable() and sorted(tmp_path.iterdir()) == before


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no folder that not even root can write to")
def test_an_output_that_cannot_be_written_is_one_line(photons, capsys):
    assert main.main(["reconstruct", str(photons[0]), "-o", "/proc/self/cloud.npz"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and "output is /proc/self/cloud.npz" in printed.err


def test_a_full_disk_is_one_line(photons, tmp_path, capsys, full_disk):
    assert main.main(["reconstruct", str(photons[0]), "-o", str(tmp_path / "cloud.npz")]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and "File too large" in printed.err


def test_notes_on_the_file_come_with_a_result_but_not_with_a_mistake(photons, tmp_path, capsys):
    command = ["reconstruct", str(photons[0]), "-o", str(tmp_path / "a.npz"), "--gate", "50,100"]      # drops photons
    assert main.main(command) == 0
    assert "photons lie outside the gate" in capsys.readouterr().err
    assert main.main([*command, "--surfaces", "9"]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and "surfaces is 9" in printed.err


def test_the_command_works_as_a_program(photons, tmp_path, repository):
    command = [sys.executable, "-m", "srt3d_ros.cli.main", "reconstruct", str(photons[0]), "--json", "-o"]
    done = subprocess.run([*command, str(tmp_path / "a.npz")], cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and json.loads(done.stdout)["points"] == 240
    done = subprocess.run([*command, str(tmp_path / "a.txt")], cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.count("\n") == 1
