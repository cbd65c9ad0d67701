"""`srt3d reconstruct`: a photon file becomes a cloud file; a mistake becomes one line and exit code 2."""

import json

import numpy as np
import pytest

import srt3d_ros
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.messages import photon_frames, sensor_message
from tests.bags import CLOUD, TEXT, write_bag


@pytest.fixture(scope="module", autouse=True)
def compiled(layers):
    """Compile the kernels of every method beforehand: in a fresh clone a bar on stderr says that it is done."""
    for method in ("pooled", "srt3d", "smle", "xcorr"):
        srt3d_ros.reconstruct(layers, method=method, surfaces=2)


@pytest.fixture
def reconstruct(layers, tmp_path, srt3d):
    """Reconstruct into a file; returns the facts of --json, and the file."""
    def run(*options, source=layers, out="cloud.npz"):
        code, printed, err = srt3d("reconstruct", source, "-o", tmp_path / out, "--json", *options)
        assert code == 0 and printed.count("\n") == 1 and all(line.startswith("srt3d: ") for line in err.splitlines())
        return json.loads(printed), tmp_path / out
    return run


@pytest.mark.parametrize(("options", "given"), [
    (["--surfaces", "2", "--false-alarm-rate", "0.03", "--background", "flat", "--device", "cpu"],
     {"surfaces": 2, "false_alarm_rate": 0.03, "background": "flat", "device": "cpu"}),
    (["--method", "smle", "--frequencies", "consecutive", "--sketch-size", "4"],
     {"method": "smle", "frequencies": "consecutive", "sketch_size": 4}),
    (["--method", "srt3d", "--frequencies", "9,2"], {"method": "srt3d", "frequencies": (9, 2)}),
    (["--method", "xcorr", "--gate", "40:250"], {"method": "xcorr", "gate": (40, 250)}),
    (["--gate", "auto"], {"gate": "auto"}),
    (["--bin-width-s", "1e-10", "--fov-deg", "20", "--num-bins", "400", "--irf-ref", "0"],
     {"bin_width_s": 1e-10, "fov_deg": 20.0, "num_bins": 400, "irf_ref": 0}),
])
def test_it_is_the_reconstruction_of_the_library(reconstruct, layers, options, given):
    facts, out = reconstruct(*options)
    cloud = srt3d_ros.reconstruct(layers, **given)
    assert list(facts) == ["method", "surfaces", "device", "rows", "cols", "num_bins", "photons", "sketch_size",
                           "frequencies", "points", "sketch_ms", "reconstruct_ms", "output"]
    for name in ("method", "surfaces", "device", "photons"):
        assert facts[name] == getattr(cloud, name), name
    assert facts["frequencies"] == list(cloud.frequencies) and facts["sketch_size"] == (len(cloud.frequencies) or None)
    assert [facts[name] for name in ("rows", "cols", "num_bins", "points")] == [
        cloud.sensor.rows, cloud.sensor.cols, cloud.sensor.num_bins, len(cloud)]
    assert facts["output"] == str(out) and facts["reconstruct_ms"] > 0 and facts["points"] > 100
    with np.load(out, allow_pickle=False) as file:
        for name in ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "background"):
            np.testing.assert_allclose(file[name], getattr(cloud, name), rtol=1e-5, err_msg=name)
            assert file[name].dtype == getattr(cloud, name).dtype
        assert file["frequencies"].tolist() == facts["frequencies"]
        assert file["bin_width_s"] == cloud.sensor.bin_width_s


def test_words_say_how_and_notes_what_was_dropped_but_not_beside_a_mistake(srt3d, refusal, layers, tmp_path):
    command = ["reconstruct", layers, "-o", tmp_path / "a.ply", "--gate", "50:149"]
    code, words, err = srt3d(*command)
    assert code == 0 and words.startswith("6,9") and f"\n{tmp_path / 'a.ply'}\n" in words
    assert "photons of 12 × 20 pixels, T = 100 bins → sketch of 10 in " in words and "ms by pooled on cpu" in words
    assert "photons lie outside the gate" in err and (tmp_path / "a.ply").read_bytes().startswith(b"ply\n")
    assert "sketch" not in srt3d(*command, "--method", "xcorr")[1]
    assert "surfaces is 9" in refusal(*command, "--surfaces", "9")


def test_a_frame_of_a_bag_is_reconstructed_as_from_a_file(layers, reconstruct, tmp_path):
    few = PhotonEvents(np.zeros(5, np.uint32), np.arange(5, dtype=np.uint16))
    whole = srt3d_ros.read(layers)
    described = ("/sensor", TEXT, sensor_message.encode_cdr(whole.sensor))
    bag = write_bag(tmp_path / "bag", [described, *(
        (f"/{side}/photons", CLOUD, photon_frames.PHOTONS.encode_cdr(frame, whole.sensor, ""))
        for side, frame in (("left", few), ("right", few), ("left", whole.frame)))])
    _, from_file = reconstruct(out="file.npz")
    _, from_bag = reconstruct("--frame", "1", "--photons-topic", "/left/photons", source=bag)
    assert np.array_equal(np.load(from_file)["xyz"], np.load(from_bag)["xyz"])


OUT = ("-o", "a.npz")

@pytest.mark.parametrize(("arguments", "expected"), [
    (("absent.npz", *OUT), "absent.npz"), ((".", *OUT), ".: no bag, as it has no file that ends in .mcap or .db3"),
    (("\x1b[2Jno\nfile.npz", *OUT), "\\x1b[2Jno file.npz"),
    (("FILE", *OUT, "--frame", "1"), "--frame is 1"), (("FILE",), "-o"),
    (("FILE", "-o", "cloud.obj"), "output is cloud.obj"), (("FILE", "-o", "absent/a.npz"), "no directory absent"),
    (("FILE", *OUT, "--surfaces", "5"), "--surfaces is 5"), (("FILE", *OUT, "--surfaces", "two"), "--surfaces"),
    (("FILE", *OUT, "--gate", "5"), "--gate is 5: expected off, FIRST-LAST (100-400)"),
    (("FILE", *OUT, "--irf", "absent.npy"), "absent.npy: no such"),
    (("FILE", *OUT, "--num-bins", "100"), "photons lie outside 0 to below 100 bins"),
    (("FILE", *OUT, "--method", "xcorr", "--sketch-size", "5"),
     "xcorr works on all times of arrival and takes no --sketch-size"),
], ids=lambda value: None)
def test_a_mistake_is_one_line_and_exit_code_2(layers, tmp_path, monkeypatch, refusal, arguments, expected):
    monkeypatch.chdir(tmp_path)
    assert expected in refusal("reconstruct", *(layers if word == "FILE" else word for word in arguments))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["INPUT", "--irf"])
def test_no_file_that_is_read_is_replaced(layers, tmp_path, monkeypatch, refusal, option):
    monkeypatch.chdir(tmp_path)
    file, read = tmp_path / "a.npz", layers.read_bytes()
    file.write_bytes(read)
    source, given = (file, ()) if option == "INPUT" else (layers, (option, file))
    said = refusal("reconstruct", source, "-o", "../" + tmp_path.name + "/a.npz", *given)
    assert "it is the input" in said and file.read_bytes() == read
