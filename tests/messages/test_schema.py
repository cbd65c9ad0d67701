"""The schemas: the same as the tables that people read."""

import re

import numpy as np

from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.messages import photons, schema
from tools import schema_tables

NAMES = ["gates", "histograms", "images", "photons", "points", "sensor", "sketch", "sketch_sensor"]


def test_every_topic_has_a_schema_with_a_version(repository):
    assert sorted(path.stem for path in (repository / "msg_schemas").glob("*.json")) == NAMES
    # of images 1, `depth` was the range along the ray for pinhole cameras, too
    assert {name: schema.load(name)["schema_version"] for name in NAMES} == dict.fromkeys(NAMES, 1) | {"images": 2}


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
