"""Generated files, the sensor's schema among them, are up to date, and docs/nodes.md has every topic of the nodes."""

import re

import pytest

from srt3d_ros.nodes import all_specs
from tools.generate_docs import generated


def test_generated_files_are_up_to_date(repository):
    for path, text in generated().items():
        assert (repository / path).read_text(encoding="utf-8") == text, f"{path}: run python -m tools.generate_docs"


@pytest.mark.parametrize("name", all_specs())
def test_the_page_has_every_topic_of_a_node(repository, name):
    text = (repository / "docs" / "nodes.md").read_text(encoding="utf-8")
    for topic in (*all_specs()[name].inputs, *all_specs()[name].outputs):
        assert re.search(rf"^\| `{topic.name}` \|.*\b{name}\b", text, re.MULTILINE), topic.name
