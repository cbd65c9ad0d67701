"""The schemas are JSON Schemas; the page of messages has a table of each."""

import pytest
from jsonschema import Draft202012Validator

from srt3d_ros.messages import schema_files as schema
from tools import schema_tables

VERSIONS = {"gates": 1, "histograms": 1, "images": 2, "photons": 1, "points": 1, "sketch": 2}


def test_every_topic_has_a_schema_with_a_version(repository):
    names = sorted(path.stem for path in (repository / "msg_schemas").glob("*.json"))
    assert names == sorted([*VERSIONS, "sensor"])
    assert {name: schema.load(name)["x-version"] for name in VERSIONS} == VERSIONS
    assert schema.load("sensor")["properties"]["schema_version"] == {
        "type": "integer", "const": 1, "x-unit": "1", "description": "1"}


@pytest.mark.parametrize("name", [*VERSIONS, "sensor"])
def test_schemas_are_of_the_draft_that_they_name(name):
    assert schema.load(name)["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(schema.load(name))


def test_the_page_has_the_tables_of_all_schemas(repository):
    text = (repository / "docs" / "messages.md").read_text(encoding="utf-8")
    names = [name for _, name, _ in schema_tables.MARKED.findall(text)]
    assert sorted(names) == sorted([*VERSIONS, "sensor"])
