"""The table "When nothing comes" of docs/quickstart-driver.md: for each cause, the nodes say what the page quotes."""

import json
import re
import sys
import time
from array import array

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String

from srt3d_ros.nodes.topics import LATCHED
from srt3d_ros.nodes.transport import PROFILE_VARIABLE
from srt3d_ros.processes import Process
from tests.docs import pages
from tests.nodes.conftest import Graph

PAGE, DRIVER = "docs/quickstart-driver.md", "examples/spad_driver.py"
TABLE = "When nothing comes"
CYCLES, NOTHING = 4, 65535
WALL = 80               # the bin that everything is in
DAY_NS = 86_400 * 10**9
BURST = 5               # frames in 10 ms, the time that a slow reconstruction of one takes
ENOUGH = 500            # frames, after which a machine that has lost none will lose none


@pytest.fixture(scope="module")
def page(repository) -> str:
    return (repository / PAGE).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def quoted(page):
    """A function: as a regular expression, the one message in the table that has this in it; numbers may differ."""
    messages = {code for row in pages.rows(pages.section(page, TABLE)) for cell in row for code in pages.inline(cell)}

    def find(part: str) -> str:
        found = [message for message in messages if re.search(part, message)]
        assert len(found) == 1, f"expected one message with {part!r} in the table: {found}"
        return re.sub(r"\d+", r"\\d+", ".*".join(map(re.escape, re.split(r"\s*…\s*", found[0]))))

    return find


@pytest.fixture(scope="module")
def description(page) -> dict:
    """The sensor of step 2."""
    return json.loads(pages.fenced(pages.section(page, "^2"), "json")[0])


@pytest.fixture(scope="module")
def nodes(ros):
    """Sketcher and reconstructor, under the names that the page has."""
    graph = Graph("/")
    graph.reconstructor, graph.sketcher = (graph.start(name) for name in ("reconstructor", "sketcher"))
    try:
        for process in graph.processes:
            process.ready()
        yield graph
    finally:
        graph.close()


class Driver:
    """What a driver publishes, well or badly; `said` and `logged` wait for what the nodes say to it."""

    def __init__(self, nodes: Graph, sensor: dict):
        self.nodes, self.sensor, self.publishers = nodes, sensor, []
        self._reported = {name: len(nodes.all_reports(name)) for name in ("sketcher", "reconstructor")}  # before
        self._logged = len(nodes.sketcher.text)

    def publish(self, topic: str, message_type: type = Image, qos: QoSProfile | None = None):
        """A publisher on this topic."""
        publisher = self.nodes.node.create_publisher(message_type, topic, qos or QoSProfile(depth=100))
        self.publishers.append(publisher)
        return publisher

    def describe(self, qos: QoSProfile = LATCHED, **changes) -> None:
        """Publish the description; a key that is None is left out."""
        sensor = {key: value for key, value in (self.sensor | changes).items() if value is not None}
        self.publish("/sensor", String, qos).publish(String(data=json.dumps(sensor)))

    def described(self) -> None:
        """Publish the description, and wait for the sketcher, which forgot the last when it was deactivated."""
        self.describe()
        self.logged("sensor on /sensor: ")

    def gates(self):
        """A publisher of gates that the sketcher has found."""
        return self.nodes.matched(self.publish("/gates"))

    def said(self, pattern: str, node: str = "sketcher", key: str = "message", again=lambda: None) -> None:
        """Wait until the node's diagnostics say so; `again` is called in the meantime."""
        def is_said() -> bool:
            again()
            reports = self.nodes.all_reports(node)[self._reported[node]:]
            return any(re.search(pattern, report[key]) for report in reports)

        self.nodes.wait(is_said, f"{pattern!r} as {key} of {node}")

    def logged(self, pattern: str) -> None:
        self.nodes.wait(lambda: re.search(pattern, self.nodes.sketcher.text[self._logged:]), f"{pattern!r} in the log")


def gates(word: int = WALL, age_ns: int = 0) -> Image:
    """A message of gates, all of whose words are the same."""
    message = Image(height=CYCLES * 32, width=32, encoding="16UC1", step=2 * 32)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns() - age_ns, 10**9)
    message.data = array("B", array("H", [word] * (CYCLES * 32 * 32)).tobytes())
    return message


@pytest.fixture
def driver(nodes, description):
    """A driver for a sketcher that knows of none: it was deactivated and activated."""
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert nodes.call(ChangeState, "sketcher/change_state", request).success
    driver = Driver(nodes, description)
    yield driver
    for publisher in driver.publishers:
        nodes.node.destroy_publisher(publisher)


def test_no_driver(driver, quoted):
    driver.said(quoted("waiting for a sensor"))


def test_no_description(driver, quoted):
    driver.gates().publish(gates())
    driver.said(quoted("no_sensor"))


def test_a_description_with_a_mistake(driver, quoted):
    driver.describe(num_bins=None, numbins=153)
    driver.said(quoted("numbins"), key="last_error")


def test_best_effort(driver, quoted):
    driver.described()
    driver.publish("/gates", qos=QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT))
    driver.logged(quoted("RELIABILITY"))
    driver.said(quoted("^1 publishes"))


def test_not_latched(driver, quoted):
    driver.describe(QoSProfile(depth=1, durability=DurabilityPolicy.VOLATILE))
    driver.logged(quoted("DURABILITY"))


def test_another_topic(driver, quoted):
    driver.described()
    driver.said(quoted("no frame yet: nobody publishes"))


def test_another_type(driver, quoted):
    driver.described()
    driver.publish("/gates", String)
    driver.said(quoted("but there is"))


def test_a_driver_that_stops(driver, quoted):
    driver.described()
    driver.gates().publish(gates())
    driver.said(quoted("^no frame for"))


@pytest.mark.parametrize("sensor, message", [
    ({"gates": {"first_word": 100, "no_detection": NOTHING}}, "gates word"),
    ({"rows": 33}, "height"),
])
def test_another_sensor_than_described(driver, quoted, sensor, message):
    driver.sensor = driver.sensor | sensor
    driver.described()
    driver.gates().publish(gates(word=78))
    driver.said(quoted("malformed"))
    driver.said(quoted(message), key="last_error")


def test_messages_larger_than_the_shared_memory(driver, quoted, repository, nodes):
    environment = ["env", "-u", PROFILE_VARIABLE]
    process = Process([*environment, sys.executable, str(repository / DRIVER)])
    nodes.processes.append(process)
    before = {key: nodes.total("sketcher", key) for key in ("frames_in", "message_lost")}

    def skip_where_all_arrives() -> None:
        frames, lost = (nodes.total("sketcher", key) - count for key, count in before.items())
        if frames > ENOUGH and not lost:
            pytest.skip("this machine is fast enough without shared memory")

    try:
        driver.said(quoted("lost on the way"), again=skip_where_all_arrives)
    finally:
        process.stop()


def test_a_reconstructor_that_is_too_slow(driver, quoted, nodes):
    slow = [Parameter("upsampling", value=4).to_parameter_msg(), Parameter("surfaces", value=4).to_parameter_msg()]
    results = nodes.call(SetParameters, "reconstructor/set_parameters", SetParameters.Request(parameters=slow)).results
    assert all(result.successful for result in results), results
    driver.described()
    publisher = driver.gates()

    def too_many() -> None:
        for _ in range(BURST):
            publisher.publish(gates())

    driver.said(quoted("queue"), "reconstructor", again=too_many)


def test_stamps_of_another_clock(driver, quoted):
    driver.described()
    publisher = driver.gates()
    driver.said(quoted("s old"), again=lambda: publisher.publish(gates(age_ns=DAY_NS)))


def test_frames_without_a_surface(driver, page, nodes):
    (row,) = [row for row in pages.rows(pages.section(page, TABLE)) if "0 points" in row[0]]
    photons, points = re.findall(r"`(\w+_per_s)`", row[1])
    driver.described()
    publisher, clouds = driver.gates(), nodes.collect(PointCloud2, "/points")
    nodes.wait(lambda: nodes.report("reconstructor").get(points) == "0.0", "no points")

    def seen() -> bool:
        publisher.publish(gates(NOTHING))
        report = nodes.report("sketcher")
        return report[photons] == "0.0" and float(report["rate_out_hz"]) > 0

    nodes.wait(seen, "frames without photons")
    nodes.wait(lambda: clouds, "a cloud")
    assert clouds[-1].width * clouds[-1].height == 0 and nodes.report("reconstructor")[points] == "0.0"
