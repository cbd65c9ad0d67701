"""Generated files are up to date, and the nodes' page and picture name all that is in the specs."""

import re
from xml.etree import ElementTree

import pytest

from srt3d_ros.nodes.specs import SPECS
from tools import graph, node_reference
from tools.generate_docs import generated

TOPICS = {topic.name for spec in SPECS.values() for topic in (*spec.inputs, *spec.outputs)}


@pytest.mark.parametrize("path", generated())
def test_a_generated_file_is_up_to_date(repository, path):
    assert (repository / path).read_text(encoding="utf-8") == generated()[path], "run python -m tools.generate_docs"


@pytest.mark.parametrize("name", SPECS)
def test_the_page_has_every_topic_service_and_parameter_of_a_node(name):
    spec, text = SPECS[name], node_reference.page(SPECS.values())
    own = re.search(rf"\n## {name}\n(.*?)(\n## |\Z)", text, re.DOTALL)[1]
    everywhere = text.partition("\n## Diagnostics")[0]
    assert all(f"`~/{service}`" in own for service in spec.services)
    assert all(f"| `{one.name}` |" in own + everywhere for one in spec.table)
    for topic in (*spec.inputs, *spec.outputs):
        assert re.search(rf"^\| `{topic.name}` \|.*\b{name}\b", everywhere, re.MULTILINE), topic.name


def test_the_picture_has_every_node_once_and_every_topic():
    root = ElementTree.fromstring(graph.draw(SPECS.values()))
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert sorted(text for text in texts if text in SPECS) == sorted(SPECS)
    assert {name for name in TOPICS if not name.startswith("/")} <= set(texts)
