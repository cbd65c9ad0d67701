"""Generated files are up to date, and the nodes' page names all topics of the specs."""

import re

import pytest

from srt3d_ros.nodes import all_specs
from tools.generate_docs import generated


@pytest.mark.parametrize("path", generated())
def test_a_generated_file_is_up_to_date(repository, path):
    assert (repository / path).read_text(encoding="utf-8") == generated()[path], "run python -m tools.generate_docs"


@pytest.mark.parametrize("name", all_specs())
def test_the_page_has_every_topic_of_a_node(repository, name):
    text = (repository / "docs" / "nodes.md").read_text(encoding="utf-8")
    for topic in (*all_specs()[name].inputs, *all_specs()[name].outputs):
        assert re.search(rf"^\| `{topic.name}` \|.*\b{name}\b", text, re.MULTILINE), topic.name
