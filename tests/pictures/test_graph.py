"""The picture of the graph is drawn from the nodes' tables, and has all that is in them."""

from xml.etree import ElementTree

import pytest

from srt3d_ros.nodes.tables import INTERFACES
from srt3d_ros.pictures import graph


@pytest.fixture(scope="module")
def texts() -> list[str]:
    """What is written in the picture."""
    root = ElementTree.fromstring(graph.draw(INTERFACES.values()))
    return [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]


def test_every_node_is_in_it_once(texts):
    assert sorted(text for text in texts if text in INTERFACES) == sorted(INTERFACES)


def test_every_topic_is_in_it(texts):
    topics = {topic.name for interface in INTERFACES.values() for topic in (*interface.inputs, *interface.outputs)}
    assert {name for name in topics if not name.startswith("/")} <= set(texts)
