"""The schemas: found where they are installed, loaded by the code, and the same as the tables that people read."""

import shutil
import subprocess
import sys

import pytest

from srt3d_ros.messages import schema
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


@pytest.mark.parametrize(("text", "sketch_size", "size"), [(6, 3, 6), ("2m", 3, 6), ("4 + 8m", 10, 84), ("16", 1, 16)])
def test_sizes_that_depend_on_the_sketch_size(text, sketch_size, size):
    assert schema.size(text, sketch_size) == size


def test_readme_has_the_tables_of_the_schemas(repository):
    text = (repository / "msg_schemas" / "README.md").read_text(encoding="utf-8")
    assert text == schema_tables.readme(), "run `python -m tools.generate_docs`"
    assert sorted(name for _, name, _ in schema_tables.MARKED.findall(text)) == NAMES


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
