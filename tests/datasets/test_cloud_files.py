"""Saved clouds, read by parsers of our own; and what happens to a path that cannot be used."""

import base64
import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.datasets import cloud_files
from srt3d_ros.errors import InvalidInput

FREQUENCIES = (1, 2, 5)
PLY_TYPES = {"float": "<f4", "uchar": "u1", "uint16": "<u2"}


@pytest.fixture
def saved(tmp_path, ball):
    """Save the ball under a name, return the path."""
    def save(name, cloud=ball[0]):
        cloud_files.save(replace(cloud, frequencies=FREQUENCIES), tmp_path / name)
        return tmp_path / name
    return save


def read_ply(path):
    head, _, body = path.read_bytes().partition(b"\nend_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    (count,) = [int(line.split()[2]) for line in lines if line.startswith("element vertex ")]
    fields = [(line.split()[2], PLY_TYPES[line.split()[1]]) for line in lines if line.startswith("property ")]
    points = np.frombuffer(body, fields)
    assert len(points) == count
    return points


def test_a_frame_that_a_message_names_cannot_end_the_header(saved, ball):
    (cloud, sensor), frame_id = ball, "rig\nelement vertex 1\nend_header\r\x1b\ud800"
    path = saved("cloud.ply", replace(cloud, sensor=sensor.replace(frame_id=frame_id)))
    assert len(read_ply(path)) == len(cloud)


def test_ply_holds_the_points_their_colours_and_what_cloudcompare_shows_as_scalar_fields(saved, ball):
    points, cloud = read_ply(saved("cloud.PLY")), ball[0]
    assert points.dtype.names[:7] == ("x", "y", "z", "intensity", "red", "green", "blue")
    scalars = {"depth_std": cloud.depth_std_bins * np.float32(cloud.sensor.bin_width_m),
               "background": cloud.background[cloud.row, cloud.col]}
    scalars |= {name: getattr(cloud, name) for name in ("row", "col", "surface")}
    assert points.dtype.names[7:] == tuple(f"scalar_{name}" for name in scalars)
    for name, values in scalars.items():
        assert np.allclose(points[f"scalar_{name}"], values, rtol=1e-6), name
    assert np.array_equal(np.stack([points[axis] for axis in "xyz"], axis=1), ball[0].xyz)
    assert np.array_equal(points["intensity"], ball[0].intensity)
    near, far = (points[at(np.linalg.norm(ball[0].xyz, axis=1))] for at in (np.argmin, np.argmax))
    assert near["red"] > 200 and near["green"] > 200 and far["blue"] > max(far["red"], far["green"])


def test_pcd_is_as_its_document_says(saved, ball):
    """https://pointclouds.org/documentation/tutorials/pcd_file_format.html: this order of lines, then packed points."""
    head, _, body = saved("a.pcd").read_bytes().partition(b"DATA binary\n")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    assert " ".join(name for name, *_ in lines) == "VERSION FIELDS SIZE TYPE COUNT WIDTH HEIGHT VIEWPOINT POINTS"
    header = {name: values for name, *values in lines}
    assert (header["VERSION"], header["HEIGHT"], header["WIDTH"]) == (["0.7"], ["1"], header["POINTS"])
    kinds = [f"<{kind.lower()}{size}" for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
    points = np.frombuffer(body, list(zip(header["FIELDS"], kinds, strict=True)))
    assert np.array_equal(points, ball[0].to_records()) and header["POINTS"] == [str(len(ball[0]))]


def test_csv_has_every_number_to_the_bit(saved, ball):
    records = ball[0].to_records()
    read = np.genfromtxt(saved("a.csv"), delimiter=",", names=True, dtype=np.float64)
    assert read.dtype.names == records.dtype.names
    for name in records.dtype.names:
        assert np.array_equal(read[name].astype(records.dtype[name]), records[name]), name
    assert np.array_equal(np.stack([records[axis] for axis in "xyz"], axis=1), ball[0].xyz)


def test_tif_is_the_depth_image(saved, ball):
    with Image.open(saved("a.tif")) as image:
        assert (image.format, image.mode) == ("TIFF", "F")
        assert np.array_equal(np.asarray(image), ball[0].depth_image(), equal_nan=True)


class Scripts(HTMLParser):
    """The text of each script by its id, and what the page would load."""

    def __init__(self, path):
        super().__init__()
        self.inside, self.scripts, self.loads = None, {}, []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        self.inside = dict(attrs).get("id", "code") if tag == "script" else self.inside
        self.loads += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        self.inside = None if tag == "script" else self.inside

    def handle_data(self, data):
        if self.inside:
            self.scripts[self.inside] = self.scripts.get(self.inside, "") + data


def test_a_page_has_the_points_and_the_colours_of_pictures_and_loads_nothing(tmp_path, ball):
    cloud, notes = ball[0], ("</script><script>alert(1)</script>", "a note")
    replace(cloud, notes=notes).save(tmp_path / "a.html")
    page = Scripts(tmp_path / "a.html")
    facts, data = json.loads(page.scripts["facts"]), base64.b64decode(page.scripts["points"])
    assert page.loads == [] and set(page.scripts) == {"facts", "points", "code"} and facts["notes"] == list(notes)
    assert (tmp_path / "a.html").stat().st_size < 40_000 + len(page.scripts["points"])
    records = cloud.to_records()
    assert data[:records.nbytes] == records.tobytes()
    kinds = [(name, facts["fields"][name][0]) for name in records.dtype.names]
    assert facts["count"] == len(cloud) and facts["size"] == np.dtype(kinds).itemsize
    levels = np.frombuffer(data[records.nbytes:], np.uint8).reshape(len(facts["quantities"]), len(cloud))
    labels = [shown["label"] for shown in facts["quantities"]]
    assert labels == ["range, m", "intensity, photons", "depth_std, mm", "signal to noise"]
    for name, row in zip(("range", "intensity", "depth_std"), levels):
        values = np.linalg.norm(cloud.xyz, axis=1) if name == "range" else records[name]
        assert np.corrcoef(row, values)[0, 1] > 0.95, name
    near = np.frombuffer(base64.b64decode(facts["quantities"][0]["table"]), np.uint8).reshape(256, 3)[0]
    assert near[:2].min() > near[2] + 100      # yellow


def test_a_page_of_a_cloud_without_points_or_accuracy(saved, ball):
    nothing = Scripts(saved("a.html", ball[0].within(max_m=0))).scripts
    assert json.loads(nothing["facts"])["count"] == 0 and "points" not in nothing
    unknown = replace(ball[0], depth_std_bins=np.full(len(ball[0]), np.nan, np.float32))
    assert "depth_std, mm" not in Scripts(saved("b.html", unknown)).scripts["facts"]


def test_a_missing_package_is_named_before_anything_is_computed(monkeypatch, tmp_path):
    monkeypatch.setattr(cloud_files, "find_spec", lambda name: None)
    for name, package, extra in (("a.png", "matplotlib", "pictures"), ("a.tif", "PIL", "pictures")):
        with pytest.raises(InvalidInput, match=rf"{name}: {package} is missing .pip install '.\[{extra}\]'"):
            cloud_files.check(tmp_path / name)
    cloud_files.check(tmp_path / "a.npz")


def test_an_empty_cloud_is_a_valid_file(saved, ball):
    nothing = ball[0].within(max_m=0)
    assert len(np.load(saved("a.npz", nothing))["row"]) == len(read_ply(saved("a.ply", nothing))) == 0
    assert saved("a.csv", nothing).read_text().count("\n") == 1 and b"POINTS 0" in saved("a.pcd", nothing).read_bytes()


@pytest.mark.parametrize("name, expected", [
    ("cloud.laz", "output is .*cloud.laz: expected a file name that ends in .npz, .ply, .pcd, .csv, .html"),
    ("cloud", "output is .*cloud: expected a file name that ends in"),
    ("absent/cloud.ply", "Cannot write .*cloud.ply: there is no directory .*absent"),
    ("folder.ply", "Cannot write .*folder.ply: it is a directory"),
    (f"{300 * 'a'}.ply", "Cannot write .*a.ply .File name too long"),
])
def test_a_path_that_cannot_be_used_is_refused_in_one_line(saved, tmp_path, name, expected):
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InvalidInput, match=f"^{expected}") as caught:
        saved(name)
    assert "\n" not in str(caught.value)
