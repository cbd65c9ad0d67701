"""The policy for SROS 2 lets every node do what it does, and nobody but the operator what the operator may."""

import xml.etree.ElementTree as ElementTree

import pytest
from sensor_msgs.msg import PointCloud2

from srt3d_ros.nodes.specs import SPECS
from tools.policy import LIFECYCLE, PARAMETERS, policy

KINDS = {("topic", "publish"), ("topic", "subscribe"), ("service", "reply"), ("service", "request")}


@pytest.fixture(scope="module")
def allowed() -> dict[tuple[str, str, str], set[str]]:
    """Full names by (enclave, kind, verb)."""
    found = {}
    for enclave in ElementTree.fromstring(policy(SPECS.values()).encode()).iter("enclave"):
        for profile in enclave.iter("profile"):
            for kind, verb in KINDS:
                for rules in profile.iterfind(f"{kind}s[@{verb}='ALLOW']"):
                    of = found.setdefault((enclave.get("path"), kind, verb), set())
                    of |= {_full(rule.text, profile.get("node")) for rule in rules}
    return found


def _full(name: str, node: str) -> str:
    return name if name.startswith("/") else f"/{name.replace('~', node)}"


@pytest.mark.parametrize("name", ["recorder", "reconstructor"])
def test_all_that_a_node_does_is_allowed(graph, allowed, tmp_path, name):
    extra = {"path": tmp_path / "out.rrd"} if name == "recorder" else {}
    graph.collect(PointCloud2, "points")
    graph.start(name, **extra).ready()
    graph.reports(name, "frames_in", 0)
    node, namespace = graph.node, graph.namespace
    ways = {("topic", "publish"): node.get_publisher_names_and_types_by_node,
            ("topic", "subscribe"): node.get_subscriber_names_and_types_by_node,
            ("service", "reply"): node.get_service_names_and_types_by_node,
            ("service", "request"): node.get_client_names_and_types_by_node}
    graph.wait(lambda: (name, namespace) in node.get_node_names_and_namespaces(), "the node in the graph")
    graph.wait(lambda: len(ways["service", "reply"](name, namespace)) > len(LIFECYCLE + PARAMETERS), "its services")
    for way, does in ways.items():
        done = {f"/{full.removeprefix(f'{namespace}/').lstrip('/')}" for full, _ in does(name, namespace)}
        assert done <= allowed.get((f"/srt3d/{name}", *way), set()), way


def test_only_the_operator_may_change_anything(allowed):
    for (enclave, kind, verb), names in allowed.items():
        if (kind, verb) == ("service", "request") and enclave != "/srt3d/operator":
            assert {name.split("/")[-1] for name in names} == {"get_parameters", "list_parameters"}, enclave
    for spec in SPECS.values():
        for service in ("set_parameters", "change_state", *(service.name for service in spec.services)):
            assert f"/{spec.name}/{service}" in allowed["/srt3d/operator", "service", "request"]


def test_one_process_may_what_its_nodes_may(allowed):
    for kind, verb in KINDS:
        of_nodes = (allowed.get((f"/srt3d/{name}", kind, verb), set()) for name in SPECS)
        assert allowed["/srt3d/all", kind, verb] == set().union(*of_nodes)
