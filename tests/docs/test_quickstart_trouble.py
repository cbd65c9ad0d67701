"""The table "When nothing comes" of docs/quickstart-driver.md: the nodes have its words, and say them to a bad driver.

tests/nodes has the other causes: silence, clocks, contradictions, bad messages, overload.
"""

import json
import re
import sys

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import String

from srt3d_ros.nodes.topics import LATCHED
from srt3d_ros.nodes.transport import PROFILE_VARIABLE
from tests.docs import pages
from tests.nodes.conftest import Graph
from tests.processes import Process

PAGE, DRIVER = "docs/quickstart-driver.md", "examples/spad_driver.py"
TABLE = "When nothing comes"
WORDS = "is|are|of|on|expected|no_sensor|malformed|queue|my_sensor|json"
VARIABLE = re.compile(rf'…|[\d.]+|/\w+|"\w+"|[:,;()]|\b(?:{WORDS})\b')
PUT_TOGETHER = {"offering incompatible QoS", "waiting for a sensor description", "waiting for a frame"}    # of words
ENOUGH = 500            # frames, after which a machine that has lost none will lose none


@pytest.fixture(scope="module")
def page(repository) -> str:
    return (repository / PAGE).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def messages(page) -> set[str]:
    """What the table quotes."""
    return {code for row in pages.rows(pages.section(page, TABLE)) for cell in row for code in pages.inline(cell)}


@pytest.fixture(scope="module")
def quoted(messages):
    """A function: as a regular expression, the one message in the table that has this in it; numbers may differ."""
    def find(part: str) -> str:
        (found,) = [message for message in messages if re.search(part, message)]
        return re.sub(r"\d+", r"\\d+", ".*".join(map(re.escape, re.split(r"\s*…\s*", found))))

    return find


def test_every_message_is_in_the_source_but_for_its_variables(messages, repository):
    source = "\n".join(path.read_text(encoding="utf-8") for path in (repository / "srt3d_ros").rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)        # literals of several lines
    sentences = [message for message in messages if len(message.split()) > 2 and not message.startswith("ros2")]
    parts = {part.strip() for message in sentences for part in VARIABLE.split(message)}
    assert len(sentences) > 15 and {part for part in parts if part not in source} == PUT_TOGETHER


@pytest.fixture(scope="module")
def nodes(ros):
    graph = Graph("/")
    try:
        graph.start("sketcher").ready()
        yield graph
    finally:
        graph.close()


class Driver:
    """What a driver publishes, well or badly; `said` and `logged` wait for what the sketcher says to it."""

    def __init__(self, nodes: Graph, sensor: dict):
        self.nodes, self.sensor, self.publishers = nodes, sensor, []
        self._sketcher = nodes.processes[0]
        self._reported, self._logged = len(nodes.all_reports("sketcher")), len(self._sketcher.text)     # before

    def publish(self, topic: str, message_type: type = Image, qos: QoSProfile | None = None):
        """A publisher on this topic."""
        publisher = self.nodes.node.create_publisher(message_type, topic, qos or QoSProfile(depth=100))
        self.publishers.append(publisher)
        return publisher

    def describe(self, qos: QoSProfile = LATCHED, **changes) -> None:
        """Publish the description; a key that is None is left out."""
        sensor = {key: value for key, value in (self.sensor | changes).items() if value is not None}
        self.publish("/sensor", String, qos).publish(String(data=json.dumps(sensor)))

    def said(self, pattern: str, key: str = "message", again=lambda: None) -> None:
        """Wait until the diagnostics say so; `again` is called in the meantime."""
        def is_said() -> bool:
            again()
            reports = self.nodes.all_reports("sketcher")[self._reported:]
            return any(re.search(pattern, report[key]) for report in reports)

        self.nodes.wait(is_said, f"{pattern!r} as {key}")

    def logged(self, pattern: str) -> None:
        self.nodes.wait(lambda: re.search(pattern, self._sketcher.text[self._logged:]), f"{pattern!r} in the log")


@pytest.fixture
def driver(nodes, page):
    """A driver of the sensor of step 2, for a sketcher that knows of none: it was deactivated and activated."""
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert nodes.call(ChangeState, "sketcher/change_state", request).success
    driver = Driver(nodes, json.loads(pages.fenced(pages.section(page, "^2"), "json")[0]))
    yield driver
    for publisher in driver.publishers:
        nodes.node.destroy_publisher(publisher)


def test_no_driver_no_description_and_one_with_a_mistake(driver, quoted):
    driver.said(quoted("waiting for a sensor"))
    gates = driver.nodes.matched(driver.publish("/gates"))
    driver.said(quoted("no_sensor"), again=lambda: gates.publish(Image()))
    driver.describe(num_bins=None, numbins=153)
    driver.said(quoted("numbins"), key="last_error")


def test_quality_of_service_that_does_not_fit(driver, quoted):
    driver.describe(QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE))
    driver.logged(quoted("DURABILITY"))
    driver.describe()
    driver.logged("sensor on /sensor: ")
    driver.publish("/gates", qos=QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT))
    driver.logged(quoted("RELIABILITY"))
    driver.said(quoted(r"^waiting for a frame"))


def test_messages_larger_than_the_shared_memory(driver, quoted, repository, nodes):
    process = Process(["env", "-u", PROFILE_VARIABLE, sys.executable, str(repository / DRIVER)])
    nodes.processes.append(process)
    before = {key: nodes.total("sketcher", key) for key in ("frames_in", "message_lost")}

    def skip_where_all_arrives() -> None:
        frames, lost = (nodes.total("sketcher", key) - count for key, count in before.items())
        if frames > ENOUGH and not lost:
            pytest.skip("this machine is fast enough without shared memory")

    try:
        among_others = quoted("lost on the way").replace(r":\ ", ":.* ").replace(",", ".*,")     # of a busy machine
        driver.said(among_others, again=skip_where_all_arrives)
    finally:
        process.stop()
