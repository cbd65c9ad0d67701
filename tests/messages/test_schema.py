"""The schemas: found where they are installed, loaded by the code, and the same as the tables that people read."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.messages import photons, schema
from tools import schema_tables

NAMES = ["gates", "histograms", "images", "photons", "points", "sensor", "sketch", "sketch_sensor"]


def test_every_topic_has_a_schema_with_a_version(repository):
    assert sorted(path.stem for path in (repository / "msg_schemas").glob("*.json")) == NAMES
    # of images 1, `depth` was the range along the ray for pinhole cameras, too
    assert {name: schema.load(name)["schema_version"] for name in NAMES} == dict.fromkeys(NAMES, 1) | {"images": 2}


@pytest.mark.parametrize("name", ["photons", "points", "sketch"])
@pytest.mark.parametrize("sketch_size", [1, 10])
def test_fields_do_not_overlap_and_lie_within_the_point(name, sketch_size):
    for layout in schema.cloud_layouts(name, sketch_size).values():
        end = 0
        for kind, offset in sorted((layout.fields[key] for key in layout.names), key=lambda field: field[1]):
            assert end <= offset < end + kind.base.itemsize and offset % kind.base.itemsize == 0
            end = offset + kind.itemsize
        assert end <= layout.itemsize < end + 4


def test_readme_has_the_tables_of_the_schemas(repository):
    text = (repository / "msg_schemas" / "README.md").read_text(encoding="utf-8")
    assert text == schema_tables.readme(), "run `python -m tools.generate_docs`"
    assert sorted(name for _, name, _ in schema_tables.MARKED.findall(text)) == NAMES


def test_readme_shows_the_bytes_of_a_whole_message(repository, small_sensor):
    text = (repository / "msg_schemas" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| `([0-9a-f ]+)` \|", text, re.MULTILINE)
    events = PhotonEvents(np.array([1, 11], np.uint32), np.array([5, 99], np.uint16), 1_500_000_000)
    assert " ".join(shown for _, shown in rows) == photons.encode_cdr(events, small_sensor, "lidar").hex(" ")
    sizes = [len(bytes.fromhex(shown)) for _, shown in rows]
    assert [int(at) for at, _ in rows] == [sum(sizes[:row]) for row in range(len(rows))]


@pytest.mark.parametrize("share", ["msg_schemas", "share/srt3d_ros/msg_schemas"])
def test_schemas_are_found_in_a_source_tree_and_when_installed(repository, tmp_path, share):
    for name in ("__init__.py", "shared_files.py", "messages/__init__.py", "messages/schema.py"):
        (tmp_path / "lib" / "srt3d_ros" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(repository / "srt3d_ros" / name, tmp_path / "lib" / "srt3d_ros" / name)
    load = [sys.executable, "-c", "from srt3d_ros.messages import schema\n"
                                  "print(schema.load('points')['layouts']['xyzi']['point_step'])"]
    missing = subprocess.run(load, cwd=tmp_path / "lib", capture_output=True, text=True)
    assert missing.returncode != 0 and "msg_schemas/points.json is in no folder above" in missing.stderr
    shutil.copytree(repository / "msg_schemas", tmp_path / share)
    assert subprocess.run(load, cwd=tmp_path / "lib", capture_output=True, text=True, check=True).stdout == "16\n"
