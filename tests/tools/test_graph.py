"""The picture of the graph is drawn from the nodes' tables, and has all that is in them."""

from xml.etree import ElementTree

import pytest

from srt3d_ros.nodes.specs import SPECS
from tools import graph


@pytest.fixture(scope="module")
def texts() -> list[str]:
    """What is written in the picture."""
    root = ElementTree.fromstring(graph.draw(SPECS.values()))
    return [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]


def test_every_node_is_in_it_once(texts):
    assert sorted(text for text in texts if text in SPECS) == sorted(SPECS)


def test_every_topic_is_in_it(texts):
    topics = {topic.name for spec in SPECS.values() for topic in (*spec.inputs, *spec.outputs)}
    assert {name for name in topics if not name.startswith("/")} <= set(texts)
