"""`srt3d info`: any photon file in figures."""

import json

import numpy as np
import pytest
from PIL import Image

from srt3d_ros import read
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import photon_file
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.datasets.sources import FILE_READERS
from srt3d_ros.messages import sensor_message

SENSOR = SensorModel(12, 20, 600, 5e-11, np.exp(-np.linspace(-2, 2, 21)**2), toa_offset_bins=1_000)
FWHM_BINS = 2 * np.sqrt(np.log(2)) / 0.2        # of exp(−x²) with steps of 0.2


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A photon file of a wall at bin 80, SBR 4, 50 photons a pixel."""
    path = tmp_path_factory.mktemp("info") / "wall.npz"
    scene = StaticScene(SENSOR.range_m(np.full((12, 20), 80.0)))
    photon_file.save(path, SENSOR, Simulator(scene, SENSOR, sbr=4, ppp=50).frame(0)[0])
    return path


@pytest.fixture
def cube(wall, tmp_path):
    """The same photons as an array of counts."""
    photons = read(wall)
    counts = np.zeros((240, 600), np.uint16)
    np.add.at(counts, (photons.frame.pixel, photons.frame.toa), 1)
    np.save(tmp_path / "wall.npy", counts.reshape(12, 20, 600))
    return tmp_path / "wall.npy"


def test_figures_and_picture_are_those_of_the_photons(srt3d, wall, tmp_path):
    code, printed, err = srt3d("info", wall, "-o", tmp_path / "info.png", "--json")
    facts, photons = json.loads(printed), read(wall).frame.photons
    with Image.open(facts["output"]) as picture:
        assert picture.width > 1000 and len(picture.convert("RGB").getcolors(10**6)) > 20
    assert (code, err, facts["rows"], facts["cols"], facts["num_bins"]) == (0, "", 12, 20, 600)
    assert facts["photons"] == photons and facts["photons_per_pixel"] == pytest.approx(photons / 240)
    assert facts["sbr"] == pytest.approx(4, rel=0.15)
    assert facts["range_m"] == pytest.approx([7.4948, 11.9917], abs=1e-3)
    assert facts["irf_width_bins"] == pytest.approx(FWHM_BINS, abs=0.2)
    first, last = facts["gate"]
    assert first < 70 and 90 < last < 200
    assert facts["sketch_bytes"] == 240 * 4 * 21 and len(facts["frequencies"]) == 10


def test_words_say_the_same_and_what_was_assumed(srt3d, cube):
    code, words, err = srt3d("info", cube, "--bin-width-s", "5e-11")
    assert code == 0 and words.count("\n") == 4 and "12 × 20 pixels, T = 600 bins of 50 ps" in words
    assert "IRF estimated" in err and "geometry taken to be a pinhole of 30°" in err
    assert "SBR 4" in words or "SBR 3" in words


def test_a_sensor_file_describes_arrays_files_and_the_simulator(srt3d, wall, cube, tmp_path):
    def info(source, *options):
        code, printed, err = srt3d("info", source, "--sensor-file", tmp_path / "other.json", "--json", *options)
        assert (code, err) == (0, "")
        return json.loads(printed)

    other = SENSOR.replace(num_bins=640, bin_width_s=1e-10, irf_ref=0)
    (tmp_path / "other.json").write_text(sensor_message.to_json(other))
    photons, facts = read(wall).frame, info(wall)
    assert (facts["num_bins"], facts["bin_width_s"]) == (640, 1e-10)
    assert facts["notes"] == ["as given, not as in the file: num_bins, bin_width_s, irf_ref"]
    assert info(wall, "--bin-width-s", "5e-11")["range_m"][0] == pytest.approx(7.4948, abs=1e-3)
    assert info(cube)["notes"] == []
    np.savez(tmp_path / "bare.npz", pixel=photons.pixel, toa=photons.toa)
    bare = info(tmp_path / "bare.npz")
    assert (bare["rows"], bare["cols"], bare["photons"], bare["notes"]) == (12, 20, photons.photons, [])
    head = info("simulator")
    assert (head["rows"], head["num_bins"], head["notes"]) == (12, 640, []) and 2000 < head["photons"] < 2800


def test_an_empty_file_has_figures_too(srt3d, tmp_path):
    np.save(tmp_path / "dark.npy", np.zeros((3, 4, 50), np.uint8))
    code, words, _ = srt3d("info", tmp_path / "dark.npy", "--bin-width-s", "1e-10", "-o", tmp_path / "dark.png")
    assert code == 0 and "0 photons" in words and "12 pixels empty" in words and (tmp_path / "dark.png").exists()


def test_mistakes_are_one_line(refusal, wall):
    assert refusal("info", wall, "-o", "a.jpg").startswith("--output is a.jpg")
    assert refusal("info", wall, "-o", "absent/a.png").endswith(": there is no directory absent.\n")


def test_events_that_show_no_irf_are_described_like_counts(srt3d, tmp_path):
    rng = np.random.default_rng(0)
    events = {"pixel": rng.integers(0, 12, 600), "toa": rng.integers(0, 600, 600)}
    np.savez(tmp_path / "dark.npz", rows=3, cols=4, num_bins=600, bin_width_s=5e-11, **events)
    code, words, err = srt3d("info", tmp_path / "dark.npz")
    assert code == 0 and "600 photons, 50 a pixel" in words and "IRF taken to be one bin" in err


@pytest.mark.parametrize(("name", "said"), [
    ("scan.npz.gz", "scan.npz.gz is packed: unpack it first (gunzip scan.npz.gz)"),
    ("scan.json", "scan.json is no log of a TMF8829 with histograms")])
def test_packed_files_and_other_json_are_refused_for_what_they_are(srt3d, tmp_path, name, said):
    (tmp_path / name).write_text('{"histograms": [1, 2]}')
    code, _, err = srt3d("info", tmp_path / name)
    assert code == 2 and said in err and err.count("\n") == 1


def test_several_files_in_one_start(srt3d, refusal, wall, cube, tmp_path, monkeypatch):
    def no_h5py(*_):
        raise ModuleNotFoundError(name="h5py")

    monkeypatch.setitem(FILE_READERS, ".h5", no_h5py)
    (tmp_path / "a.h5").touch()
    given = wall, tmp_path / "no.npz", tmp_path / "a.h5", cube
    code, words, err = srt3d("info", *given)
    assert code == 2 and words.count("12 × 20 pixels") == 2 and "no.npz: no such file" in err
    assert "h5py is not installed: pip install '.[lab]'" in err
    assert [line for line in words.splitlines() if line.endswith((".npz", ".npy", ".h5"))] == [*map(str, given)]
    code, lines, _ = srt3d("info", wall, wall, "--json")
    assert code == 0 and [json.loads(line)["input"] for line in lines.splitlines()] == [str(wall)] * 2
    assert "--output draws one file" in refusal("info", wall, wall, "-o", tmp_path / "a.png")
