"""The schemas: the same as the tables that people read."""

from srt3d_ros.messages import schema
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


