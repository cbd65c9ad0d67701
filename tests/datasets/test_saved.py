"""Photons, sketches and clouds that were saved are read with all that they had, to the bit; and pickled."""

import base64
import io
import pickle
import re
import sys
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from PIL import Image

import srt3d_ros
from srt3d_ros import datasets
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.errors import InvalidInput
from srt3d_ros.photons import Photons
from tests.core.scenes import T, make_sensor, simulate

DEPTH = 200 + np.arange(20.0) + np.zeros((12, 1))
SENSOR = make_sensor(12, 20).replace(
    projection=Pinhole(50, 51, 9, 6, PlumbBob(0.1, k3=0.01)), gates=GateWords(3, 9), frame_id="rig",
    gain=np.linspace(0.5, 2, 240).reshape(12, 20), mask=np.arange(240).reshape(12, 20) != 7, range_offset_m=0.1)
BINNED = make_sensor(12, 20).replace(
    projection=AngularScan(0.1, 0.2, 0.3, 0.4),
    histograms=HistogramBins(T // 2, 0.5, 2.0, np.full(T // 2, 0.5)))
EVENTS = Photons(SENSOR, simulate(DEPTH, 10, 20), np.stack([DEPTH, DEPTH + 9]).astype(np.float32), notes=("a", "b: ü"))
COUNTS = Photons(BINNED, PhotonHistograms(
    np.random.default_rng(0).normal(3, 2, (12, 20, T // 2)).astype(np.float32), 7))
SKETCH = replace(EVENTS.sketch(gate=(5, 280)), cycles=10**9, before=np.arange(240, dtype=np.uint32).reshape(12, 20))
SCAN = Photons(SENSOR.replace(
    irf=np.random.default_rng(0).random((240, 4)), irf_ref=0, delay_bins=np.arange(240.0).reshape(12, 20),
    background_shape=np.arange(T), projection=AngularScan(0.1, -0.2, 0.3, 0.4), cycles=1504), EVENTS.frame)
RESULTS = {"events": EVENTS, "scan": SCAN, "counts": COUNTS, "sketch": SKETCH, "plain_sketch": COUNTS.sketch(4),
           "cloud": SKETCH.reconstruct(surfaces=2), "empty": COUNTS.sketch().reconstruct().within(max_m=0),
           "photons_cloud": EVENTS.reconstruct(method="xcorr")}


def differences(one, other, name: str = ""):
    """The names of the fields that are not equal to the bit."""
    if is_dataclass(one) and type(one) is type(other):
        for field in fields(one):
            yield from differences(getattr(one, field.name), getattr(other, field.name), f"{name}.{field.name}")
    elif not (np.array_equal(one, other, equal_nan=getattr(one, "dtype", None) == np.float32)
              and getattr(one, "dtype", None) == getattr(other, "dtype", None)):
        yield name


OF_THE_RUN = {".name", ".clutter", ".sketch_ms", ".reconstruct_ms"}       # not saved


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_what_was_saved_is_read_to_the_bit(result, tmp_path):
    path = tmp_path / "a.NPZ"
    result.save(path)
    again, content = srt3d_ros.read(path), path.read_bytes()
    assert {*differences(result, again)} <= OF_THE_RUN
    again.save(path)
    assert path.read_bytes() == content and [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize(("kind", "name"), [
    ("events", "a.npz"), ("sketch", "a.npz"), ("cloud", "a.npz"), ("cloud", "a.ply")])
def test_a_failed_save_leaves_the_old_file_and_nothing_else(kind, name, tmp_path, request):
    path = tmp_path / name
    RESULTS[kind].save(path)
    content = path.read_bytes()
    request.getfixturevalue("full_disk")
    with pytest.raises(InvalidInput, match=r"^Cannot write .*a\..*File too large\).$"):
        RESULTS[kind].save(path)
    assert path.read_bytes() == content and [*tmp_path.iterdir()] == [path]


def test_a_saved_sketch_gives_the_same_cloud_and_takes_options_that_a_cloud_refuses(tmp_path):
    EVENTS.sketch().save(tmp_path / "a.npz")
    cloud = EVENTS.reconstruct()
    assert {*differences(srt3d_ros.reconstruct(tmp_path / "a.npz"), cloud)} <= OF_THE_RUN
    assert srt3d_ros.read(tmp_path / "a.npz", range_offset_m=2).sensor.range_offset_m == 2
    cloud.save(tmp_path / "c.npz")
    for call, said in ((lambda: srt3d_ros.read(tmp_path / "c.npz", range_offset_m=2), "c.npz holds a cloud: no option"),
                       (lambda: srt3d_ros.reconstruct(tmp_path / "c.npz"), "A cloud cannot be reconstructed"),
                       (lambda: datasets.read_photons(tmp_path / "c.npz"), ".*c.npz holds a cloud, no photons"),
                       (lambda: cloud.save(tmp_path / "a.npz"), "Cannot write .*a.npz: that file holds something else"),
                       (lambda: EVENTS.save(tmp_path / "c.npz"), "Cannot write .*c.npz: that file holds something"),
                       (lambda: SKETCH.save("a.ply"), "output is a.ply: expected a name that ends in .npz"),
                       (lambda: SKETCH.save(3), "output is int: expected a path")):
        with pytest.raises(InvalidInput, match=f"^{said}"):
            call()


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_results_are_pickled(result):
    assert not {*differences(result, pickle.loads(pickle.dumps(result)))}


@pytest.mark.parametrize("options", [{"surfaces": 2, "false_alarm_rate": 0.1}, {"method": "smle"}, {"method": "xcorr"}])
def test_a_pickled_reconstructor_begins_anew(options):
    source = EVENTS if options.get("method") == "xcorr" else EVENTS.sketch()
    made = srt3d_ros.Reconstructor(SENSOR, getattr(source, "frequencies", ()), **options)
    first, _ = made(source), made(source)
    again = pickle.loads(pickle.dumps(made))(source)
    assert {*differences(first, again)} <= OF_THE_RUN


def test_a_notebook_shows_a_cloud_in_a_small_picture_and_in_words_without_matplotlib(monkeypatch):
    cloud = replace(RESULTS["cloud"], notes=("one",))
    words, picture = re.fullmatch(r'<pre>(.*)</pre><img alt="" src="data:image/png;base64,(.*)">', cloud._repr_html_()
                                  ).groups()
    assert words == repr(cloud) and words.endswith("; 1 note")
    content = base64.b64decode(picture)
    with Image.open(io.BytesIO(content)) as image:
        assert image.size == (320, 240) and len(content) < 60_000 and len(image.convert("RGB").getcolors()) > 20
    monkeypatch.setitem(sys.modules, "srt3d_ros.pictures.annotations", None)       # importing it fails
    assert cloud._repr_html_() == f"<pre>{words}</pre>"
