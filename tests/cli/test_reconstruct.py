"""`srt3d reconstruct`: a photon file becomes a cloud file; a mistake becomes one line and exit code 2."""

import json
import subprocess
import sys

import numpy as np
import pytest

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch_design import design_for
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets import npz, open_photons
from srt3d_ros.datasets.bag_writer import BagWriter, Offer
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.messages import cdr, photon_frames, sketch
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sensor as sensor_message

SENSOR = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), toa_offset_bins=1_000)
DEPTH = np.stack([np.full((12, 20), 80.0), np.full((12, 20), 200.0)])


@pytest.fixture(scope="module")
def photons(tmp_path_factory):
    """A photon file of two layers, and its events."""
    path = tmp_path_factory.mktemp("photons") / "layers.npz"
    events, truth = Simulator(StaticScene(SENSOR.range_m(DEPTH)), SENSOR, sbr=10, ppp=60).frame(0)
    npz.save(path, SENSOR, events, truth)
    return path, events


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A photon file of a wall at bin 80."""
    path = tmp_path_factory.mktemp("photons") / "wall.npz"
    npz.save(path, SENSOR, Simulator(StaticScene(SENSOR.range_m(DEPTH[0])), SENSOR, sbr=10, ppp=60).frame(0)[0])
    return path


@pytest.fixture
def reconstruct(photons, tmp_path, srt3d):
    """Reconstruct into a file; returns the facts of --json, and the file."""
    def run(*options, source=photons[0], out="cloud.npz"):
        code, printed, err = srt3d("reconstruct", source, "-o", tmp_path / out, "--json", *options)
        assert code == 0 and printed.count("\n") == 1 and (err == "" or "--gate" in options)
        return json.loads(printed), tmp_path / out
    return run


def test_it_is_the_reconstruction_of_the_library(reconstruct, photons):
    facts, out = reconstruct("--surfaces", "2")
    frequencies = choose("auto", SENSOR)
    cloud = Pooled(SENSOR, frequencies, surfaces=2)(sketch_photons(photons[1], SENSOR, frequencies))
    with np.load(out, allow_pickle=False) as file:
        for name in ("row", "col", "depth_bins", "intensity", "xyz", "background"):
            np.testing.assert_allclose(file[name], getattr(cloud, name), rtol=1e-5, err_msg=name)
            assert file[name].dtype == getattr(cloud, name).dtype
        assert file["frequencies"].tolist() == facts["frequencies"] and file["depth_std_bins"].dtype == np.float32
    expected = {"method": "pooled", "device": "cpu", "rows": 12, "cols": 20, "num_bins": 300, "sketch_size": 10,
                "photons": photons[1].photons, "points": len(cloud), "output": str(out)}
    assert {name: facts[name] for name in expected} == expected and len(cloud) > 400
    assert facts["sketch_ms"] > 0 and facts["reconstruct_ms"] > 0


@pytest.mark.parametrize(("order", "first"), [("nearest", 80), ("farthest", 200)])
def test_surface_order_chooses_the_first_surface_of_each_pixel(reconstruct, order, first):
    _, out = reconstruct("--surfaces", "2", "--surface-order", order)
    with np.load(out) as file:
        several = file["surface"][1:] == 1
        assert several.sum() > 200
        np.testing.assert_allclose(file["depth_bins"][:-1][several], first, atol=3)


def test_upsampling_writes_a_cloud_of_finer_pixels(reconstruct):
    facts, out = reconstruct("--upsampling", "3")
    assert (facts["rows"], facts["upsampling"], facts["points"]) == (12, 3, 9 * 240)
    with np.load(out) as file:
        assert file["background"].shape == (36, 60)
        rays = SENSOR.upsampled(3).rays[file["row"], file["col"]]
        np.testing.assert_allclose(file["xyz"], rays * SENSOR.range_m(file["depth_bins"])[:, None], rtol=1e-5)


@pytest.mark.parametrize(("suffix", "magic"), [(".ply", b"ply\n"), (".PCD", b"# .PCD"), (".rrd", b"RRF"),
                                              (".png", b"\x89PNG"), (".jpg", b"\xff\xd8")])
def test_every_format_is_written(reconstruct, suffix, magic):
    _, out = reconstruct(out="cloud" + suffix)
    assert out.read_bytes().startswith(magic) and out.stat().st_size > 240 * 16


@pytest.mark.parametrize(("options", "expected"), [
    (("--frequencies", "auto", "--sketch-size", "6"), choose("auto", SENSOR, 6)),
    (("--frequencies", "consecutive"), tuple(range(1, 11))),
    (("--frequencies", "consecutive", "--sketch-size", "4"), (1, 2, 3, 4)), (("--sketch-size", "1"), (1,)),
    (("--frequencies", "9,2", "--sketch-size", "2"), (9, 2))])
def test_frequencies_are_the_ones_asked_for(reconstruct, options, expected):
    facts, out = reconstruct(*options)
    assert facts["frequencies"] == list(expected) and facts["sketch_size"] == len(expected)
    assert np.load(out)["frequencies"].tolist() == list(expected)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_writes_a_cloud_and_says_how(reconstruct, srt3d, wall, name):
    facts, out = reconstruct("--method", name, source=wall)
    sketched = METHODS[name].needs == "sketch"
    assert (facts["method"], facts["sketch_size"]) == (name, 10 if sketched else None)
    designed = design_for(open_photons(wall).frame, SENSOR, frequencies=METHODS[name].frequencies).frequencies
    assert facts["frequencies"] == (list(designed) if sketched else [])
    assert (facts["sketch_ms"] is not None) == sketched and facts["reconstruct_ms"] > 0
    with np.load(out) as file:
        assert len(file["row"]) == facts["points"] > 230 and abs(np.median(file["depth_bins"]) - 80) < 0.5
    words = srt3d("reconstruct", wall, "-o", out, "--method", name)[1]
    assert "12 × 20 pixels" in words and f"{facts['points']} points" in words and str(out) in words
    assert f"by {name} on cpu" in words and ("sketch of 10" in words) == sketched


def test_weighting_reaches_the_method(reconstruct, wall):
    depths = []
    for weighting in ("identity", "precision"):
        _, out = reconstruct("--method", "smle", "--weighting", weighting, source=wall)
        depths.append(np.load(out)["depth_bins"])
    assert not np.array_equal(*depths)


@pytest.mark.parametrize("gate", ["off", "auto", "40:250"])
def test_a_file_of_too_many_photons_to_keep_is_sketched_in_parts(srt3d, wall, tmp_path, monkeypatch, gate):
    photons = open_photons(wall)
    counts = np.zeros((240, 300), np.uint16)
    np.add.at(counts, (photons.frame.pixel, photons.frame.toa), 1)
    np.savez(tmp_path / "cube.npz", counts=counts.reshape(12, 20, 300), bin_width_s=5e-11, irf=SENSOR.irf,
             toa_offset_bins=1_000)
    clouds = []
    for kept in (2**24, 8_000):
        monkeypatch.setattr("srt3d_ros.datasets.survey.MAX_KEPT", kept)
        code, printed, _ = srt3d("reconstruct", tmp_path / "cube.npz", "-o", tmp_path / "cloud.npz", "--gate", gate,
                                 "--frequencies", "consecutive", "--json")
        assert code == 0
        with np.load(tmp_path / "cloud.npz") as cloud:
            clouds.append((json.loads(printed)["points"], np.median(cloud["xyz"][:, 2])))
    assert clouds[0][0] == clouds[1][0] == 240 and clouds[0][1] == pytest.approx(clouds[1][1], abs=1e-3)


@pytest.fixture
def pooled_options(monkeypatch):
    """The options with which the method is built."""
    seen, build = {}, Pooled.__init__

    def record(*args, **options):
        seen.update(options)
        build(*args, **options)

    monkeypatch.setattr(Pooled, "__init__", record)
    return seen


def test_options_reach_the_method(reconstruct, pooled_options):
    given = {"surfaces": 2, "false_alarm_rate": 0.03, "device": "cpu", "background": "flat"}
    reconstruct("--surfaces", "2", "--false-alarm-rate", "0.03", "--device", "cpu", "--background", "flat")
    assert {name: pooled_options[name] for name in given} == given


def test_a_dark_frame_gives_the_background(reconstruct, refusal, photons, tmp_path):
    dark, toa = tmp_path / "dark.npz", np.repeat(np.arange(300), np.arange(300)).astype(np.uint16)      # a ramp
    npz.save(dark, SENSOR, PhotonEvents(np.arange(len(toa), dtype=np.uint32) % 240, toa))
    _, flat = reconstruct(out="flat.npz")
    _, ramp = reconstruct("--dark", dark)
    assert len(np.load(ramp)["row"]) == 240 and not np.array_equal(np.load(flat)["xyz"], np.load(ramp)["xyz"])
    npz.save(dark, SENSOR.replace(rows=20, cols=12), PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))
    said = refusal("reconstruct", photons[0], "-o", tmp_path / "a.npz", "--dark", dark)
    assert said == "dark frame rows is 20: expected 12, as in the input\n"


def test_what_the_file_does_not_say_can_be_given(reconstruct):
    facts, out = reconstruct("--bin-width-s", "1e-10", "--fov-deg", "20", "--num-bins", "400", "--irf-ref", "0")
    with np.load(out) as file:
        assert (facts["num_bins"], file["bin_width_s"], file["irf_ref"]) == (400, 1e-10, 0)
    facts, out = reconstruct("--gate", "50:149")
    assert facts["num_bins"] == 100
    assert np.median(np.load(out)["depth_bins"]) == pytest.approx(80 - 50, abs=0.5)


@pytest.mark.parametrize("method", ["pooled", "xcorr"])
def test_gate_auto_keeps_the_scene_with_its_ranges_and_drops_background(reconstruct, tmp_path, srt3d, method):
    faint = tmp_path / "faint.npz"
    npz.save(faint, SENSOR, Simulator(StaticScene(SENSOR.range_m(DEPTH[0])), SENSOR, sbr=0.3, ppp=60).frame(0)[0])
    _, whole = reconstruct("--method", method, "--gate", "off", source=faint, out="whole.npz")
    facts, gated = reconstruct("--method", method, "--gate", "auto", source=faint, out="gated.npz")
    assert facts["num_bins"] < 80 and facts["photons"] < 0.5 * 60 * 240
    ranges = [np.median(np.linalg.norm(np.load(path)["xyz"], axis=1)) for path in (whole, gated)]
    assert ranges == pytest.approx([SENSOR.range_m(80)] * 2, abs=0.5 * SENSOR.bin_width_m)
    code, _, err = srt3d("reconstruct", faint, "-o", tmp_path / "a.npz", "--gate", "auto")
    assert code == 0 and "photons lie outside the gate (bins " in err


def test_a_frame_of_a_bag_is_reconstructed_as_from_a_file(photons, reconstruct, tmp_path):
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/left/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/right/photons", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer()])
    few = PhotonEvents(np.zeros(5, np.uint32), np.arange(5, dtype=np.uint16))
    writer.write("/sensor", 0, sensor_message.encode_cdr(SENSOR))
    for k, (side, frame) in enumerate((("left", few), ("right", few), ("left", photons[1]))):
        writer.write(f"/{side}/photons", k + 1, photons_message.encode_cdr(frame, SENSOR, "lidar"))
    writer.close()
    _, from_file = reconstruct(out="file.npz")
    _, from_bag = reconstruct("--frame", "1", "--photons-topic", "/left/photons", source=tmp_path / "bag")
    assert np.array_equal(np.load(from_file)["xyz"], np.load(from_bag)["xyz"])


@pytest.mark.parametrize("options", [(), ("--gate", "auto"), ("--gate", "60:230")])
def test_histograms_in_a_bag_are_reconstructed_as_their_photons(photons, reconstruct, tmp_path, options):
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/tof/raw", "sensor_msgs/msg/Image", [Offer()])
    writer.add_topic("/sensor", "std_msgs/msg/String", [Offer()])
    writer.write("/sensor", 0, sensor_message.encode_cdr(SENSOR))
    writer.write("/tof/raw", 1, photon_frames.encode_cdr(photons[1], "histograms", SENSOR))
    writer.close()
    _, from_file = reconstruct(*options, out="file.npz")
    _, from_bag = reconstruct(*options, source=tmp_path / "bag")
    one, other = (np.load(path)["xyz"] for path in (from_file, from_bag))
    assert one.shape == other.shape and np.allclose(one, other, atol=1e-3)      # sums of float32 products


def test_a_frame_of_a_bag_of_sketches_is_reconstructed_as_its_photons(photons, srt3d, reconstruct, tmp_path):
    sketched = sketch_photons(photons[1], SENSOR, (1, 2, 5, 9))
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/spad/sketch", "sensor_msgs/msg/PointCloud2", [Offer()])
    writer.add_topic("/spad/sketch/sensor", "std_msgs/msg/String", [Offer()])
    writer.write("/spad/sketch/sensor", 0, cdr.write_text(sketch.encode_sensor(SENSOR, (1, 2, 5, 9), 1).data))
    for k, layout in enumerate(("coded", "float32")):
        writer.write("/spad/sketch", k + 1, sketch.encode_cdr(sketched, "lidar", layout))
    writer.close()
    _, from_file = reconstruct("--frequencies", "1,2,5,9", "--surfaces", "2", out="file.npz")
    _, from_bag = reconstruct("--frame", "1", "--surfaces", "2", source=tmp_path / "bag")
    _, from_coded = reconstruct("--frame", "0", "--surfaces", "2", source=tmp_path / "bag", out="coded.npz")
    wanted, found, coded = (np.load(path) for path in (from_file, from_bag, from_coded))
    assert np.allclose(wanted["xyz"], found["xyz"], rtol=1e-4)
    assert len(coded["xyz"]) == pytest.approx(len(wanted["xyz"]), rel=0.02) and len(coded["xyz"]) > 400
    assert coded["depth_bins"].mean() == pytest.approx(wanted["depth_bins"].mean(), abs=1)
    for option, field in ((("--sketch-size", "3"), "sketch_size is 3: expected nothing"),
                          (("--gate", "1:40"), "gate is (1, 40): expected nothing"),
                          (("--method", "rt3d"), "method is rt3d: expected one that takes sketches")):
        code, _, err = srt3d("reconstruct", tmp_path / "bag", *OUT, *option)
        assert code == 2 and field in err and len(err.splitlines()) == 1


OUT = ("-o", "a.npz")
REFUSED = [
    (("absent.npz", *OUT), "absent.npz"), ((".", *OUT), "bag is ., without metadata.yaml"),
    (("notes.txt", *OUT), "notes.txt"), (("broken.npz", *OUT), "broken.npz"),
    (("FILE", *OUT, "--frame", "1"), "frame is 1"), (("FILE",), "-o"),
    (("FILE", "-o", "cloud.las"), "output is cloud.las"), (("FILE", "-o", "folder.npz"), "output is folder.npz"),
    (("FILE", "-o", "absent/a.npz"), "output is absent/a.npz"),
    (("FILE", "-o", "/proc/self/a.npz"), "output is /proc/self/a.npz"),
    (("FILE", *OUT, "--surfaces", "0"), "surfaces is 0"), (("FILE", *OUT, "--surfaces", "5"), "surfaces is 5"),
    (("FILE", *OUT, "--surfaces", "two"), "--surfaces"),
    (("FILE", *OUT, "--surface-order", "first"), "--surface-order: invalid choice: 'first'"),
    (("FILE", *OUT, "--false-alarm-rate", "0"), "false_alarm_rate is 0"),
    (("FILE", *OUT, "--false-alarm-rate", "nan"), "false_alarm_rate is nan"),
    (("FILE", *OUT, "--device", "cuda"), "device is cuda"), (("FILE", *OUT, "--device", "gpu"), "--device"),
    (("FILE", *OUT, "--method", "magic"), "method is magic"),
    (("FILE", *OUT, "--sketch-size", "0"), "sketch_size is 0"),
    (("FILE", *OUT, "--sketch-size", "3", "--frequencies", "1,2"), "sketch_size is 3"),
    (("FILE", *OUT, "--frequencies", "low"), "frequencies is low"),
    (("FILE", *OUT, "--frequencies", "0,1"), "frequencies is 0"),
    (("FILE", *OUT, "--frequencies", "2,2"), "frequencies is [2, 2]"),
    (("FILE", *OUT, "--frequencies", "1,150"), "frequencies is 150"),
    (("FILE", *OUT, "--gate", "5"), "gate is 5: expected off, auto, or first and last bin such as 100:400"),
    (("FILE", *OUT, "--gate", "5:x"), "gate is 5:x: expected off, auto, "),
    (("FILE", *OUT, "--gate", "250:349"), "gate is 250:349: expected first and last within the sensor's bins, 0 to"),
    (("FILE", *OUT, "--gate", "250:250"), "gate is 250:250: expected a first bin of 0 or more and below the last"),
    (("FILE", *OUT, "--gate", "250:251"), "gate is 250:251: expected 21 bins or more, as many as the IRF"),
    (("FILE", *OUT, "--gate", "100:124", "--sketch-size", "15"), "sketch_size is 15: expected 1 to 12 for T = 25 bins"),
    (("FILE", *OUT, "--irf", "absent.npy"), "irf is absent.npy"),
    (("FILE", *OUT, "--bin-width-s", "0"), "bin_width_s is 0"), (("FILE", *OUT, "--num-bins", "100"), "toa is"),
    (("FILE", *OUT, "--background", "dark"), "--background"), (("FILE", *OUT, "--dark", "absent.npz"), "absent.npz"),
    (("FILE", *OUT, "--dark", "FILE", "--background", "flat"), "background is flat"),
    (("FILE", *OUT, "--dark", "FILE", "--method", "xcorr"), "dark is"),
    (("\x1b[2Jno\nfile.npz", *OUT), "\\x1b[2Jno file.npz"),
    (("FILE", *OUT, "--method", "rt3d", "--weighting", "identity"), "weighting is identity: expected nothing: rt3d "),
    (("FILE", *OUT, "--method", "srt3d", "--false-alarm-rate", "0.1"), "false_alarm_rate is 0.1: expected nothing: "),
    (("FILE", *OUT, "--method", "xcorr", "--sketch-size", "5"),
     "sketch_size is 5: expected nothing: xcorr makes no sketch"),
    (("FILE", *OUT, "--method", "rt3d", "--frequencies", "auto"),
     "frequencies is auto: expected nothing: rt3d makes no sketch"),
    (("FILE", *OUT, "--method", "xcorr", "--device", "cuda"),
     "device is cuda: expected cpu or auto: xcorr has no CUDA kernels"),
]


@pytest.mark.parametrize(("arguments", "expected"), REFUSED, ids=lambda value: None)
def test_a_mistake_is_one_line_and_exit_code_2(photons, tmp_path, monkeypatch, refusal, arguments, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "notes.txt").write_text("no photons")
    (tmp_path / "broken.npz").write_bytes(photons[0].read_bytes()[:500])
    before = sorted(tmp_path.iterdir())
    assert expected in refusal("reconstruct", *(photons[0] if word == "FILE" else word for word in arguments))
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("option", ["INPUT", "--dark", "--irf"])
def test_no_file_that_is_read_is_replaced(photons, tmp_path, monkeypatch, refusal, option):
    monkeypatch.chdir(tmp_path)
    file, read = tmp_path / "a.npz", photons[0].read_bytes()
    file.write_bytes(read)
    source, given = (file, ()) if option == "INPUT" else (photons[0], (option, file))
    said = refusal("reconstruct", source, "-o", "../" + tmp_path.name + "/a.npz", *given)
    assert "expected another file than the input" in said and file.read_bytes() == read


def test_a_full_disk_is_one_line(photons, tmp_path, refusal, full_disk):
    assert "File too large" in refusal("reconstruct", photons[0], "-o", tmp_path / "cloud.npz")


def test_notes_on_the_file_come_with_a_result_but_not_with_a_mistake(photons, tmp_path, srt3d, refusal):
    command = ["reconstruct", photons[0], "-o", tmp_path / "a.npz", "--gate", "50:149"]      # drops photons
    code, _, err = srt3d(*command)
    assert code == 0 and "photons lie outside the gate" in err
    assert "surfaces is 9" in refusal(*command, "--surfaces", "9")


def test_the_command_works_as_a_program(photons, tmp_path, repository):
    command = [sys.executable, "-m", "srt3d_ros.cli.main", "reconstruct", photons[0], "--json", "-o"]
    done = subprocess.run([*command, tmp_path / "a.npz"], cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and json.loads(done.stdout)["points"] == 240
    done = subprocess.run([*command, tmp_path / "a.txt"], cwd=repository, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.count("\n") == 1
