"""The schemas are JSON Schemas with a version; the page of messages has a table of each."""

from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srt3d_ros.messages import schema_files

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (ROOT / "msg_schemas").glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_is_of_the_draft_that_it_names_and_has_a_version(name):
    schema = schema_files.load(name)
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(schema)
    assert (schema["properties"]["schema_version"]["const"] if name == "sensor" else schema["x-version"]) >= 1
