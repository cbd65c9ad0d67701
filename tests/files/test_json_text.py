"""Untrusted JSON: what is wrong is named, and what is too much is refused."""

import json

import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.files import json_text

SCHEMA = {"title": "sensor", "type": "object", "required": ["rows", "cols"], "additionalProperties": False,
          "properties": {"rows": {"type": "integer"}, "cols": {"type": "integer"}}}


@pytest.mark.parametrize("text, said", [
    ('{"rows": 2, "rows": 3}', 'repeated key is "rows"'), ("[1]", "sensor is list: expected one JSON object"),
    ('{"rows": NaN}', "JSON is NaN"), ('{"rows": ', "sensor is broken JSON"),
    (json.dumps({f"x_{k}": k for k in range(json_text.MAX_KEYS + 1)}), "number of keys is 1001: expected at most")])
def test_what_is_no_plain_object_is_refused(text, said):
    with pytest.raises(InvalidInput, match=f"^{said}"):
        json_text.parse(text, "sensor")


@pytest.mark.parametrize("content, field", [({"rows": 2}, "cols"), ({"cols": 2}, "rows"),
                                            ({"rows": 2, "cols": 2, "colour": 1}, "unknown key"),
                                            ({"rows": 2.5, "cols": 2}, "rows")])
def test_the_key_that_is_missing_unknown_or_wrong_is_named(content, field):
    with pytest.raises(InvalidInput) as error:
        json_text.check(content, SCHEMA)
    assert error.value.field == field


def test_as_many_keys_as_allowed_are_read():
    content = {f"x_{k}": k for k in range(json_text.MAX_KEYS)}
    assert json_text.parse(json.dumps(content), "sensor") == content
