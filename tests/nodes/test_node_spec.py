"""What a running node offers to the graph is what its spec says, and the policy for SROS 2 allows it and no more."""

import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec

import pytest
from rcl_interfaces.srv import DescribeParameters, ListParameters

from srt3d_ros.nodes.specs import SPECS
from tests.devices import made
from tools.policy import policy

OF_EVERY_NODE = ("/rosout", "/parameter_events", "/diagnostics")
OF_MANAGED_NODES = ("change_state", "get_state", "get_available_states", "get_available_transitions",
                    "get_transition_graph", "transition_event", "describe_parameters", "get_parameter_types",
                    "get_parameters", "list_parameters", "set_parameters", "set_parameters_atomically",
                    "get_type_description")
EVERYTHING = {"player": {"lossless": True},       # parameters with which a node has all its topics
              "sketcher": {"sensor_file": "config/sensors/spad_32x32_gates.json", "motion": "odom"},
              "bag_recorder": {"topics": ",".join(topic.name for topic in SPECS["bag_recorder"].inputs)}}
NEVER_TOGETHER = {"player": {"gates", "histograms", "sketch", "sketch/sensor", "/clock", "odom", "imu", "/tf_static"},
                  "sketcher": {"imu", *(set() if find_spec("tf2_msgs") else {"/tf_static"})}}


@pytest.fixture(params=SPECS)
def running(request, graph, photon_file, tmp_path):
    """A node that is ready, and its table."""
    name = request.param
    extra = {"player": {"input": photon_file}, "recorder": {"path": tmp_path / "out.rrd"},
             "bag_recorder": {"path": tmp_path / "bag"}, "device": {"log": tmp_path / "log.json"}}.get(name, {})
    made.tmf8829_log(tmp_path / "log.json", [made.zones_16(1.0)])
    graph.start(name, **extra, **EVERYTHING.get(name, {})).ready()
    return name, SPECS[name]


def test_topics_services_and_parameters_are_those_of_the_spec_and_allowed(graph, running, allowed):
    name, spec = running
    never = NEVER_TOGETHER.get(name, set())

    def relative(names_and_types) -> dict[str, str]:
        named = ((full.removeprefix(f"{graph.namespace}/"), types[0]) for full, types in names_and_types)
        return {topic: kind for topic, kind in named if topic not in OF_EVERY_NODE
                and topic.removeprefix(f"{name}/") not in OF_MANAGED_NODES}

    def declared(topics) -> dict[str, str]:
        return {topic.name: topic.type for topic in topics
                if topic.name not in (never | set(OF_EVERY_NODE))}

    node, namespace = graph.node, graph.namespace
    graph.wait(lambda: (name, namespace) in node.get_node_names_and_namespaces(), f"{name} in the graph")
    services = {f"{name}/{service}": "std_srvs/srv/Trigger" for service in spec.services}
    graph.wait(lambda: relative(node.get_subscriber_names_and_types_by_node(name, namespace))
               == declared(spec.inputs), "the inputs of the table")
    graph.wait(lambda: relative(node.get_publisher_names_and_types_by_node(name, namespace))
               == declared(spec.outputs), "the outputs of the table")
    graph.wait(lambda: relative(node.get_service_names_and_types_by_node(name, namespace)) == services,
               "the services of the table")
    listed = graph.call(ListParameters, f"{name}/list_parameters", ListParameters.Request()).result.names
    of_ros = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    assert {one for one in listed if not one.startswith(of_ros)} == {one.name for one in spec.table}
    names = [parameter.name for parameter in spec.table]
    described = graph.call(DescribeParameters, f"{name}/describe_parameters", DescribeParameters.Request(names=names))
    for parameter, descriptor in zip(spec.table, described.descriptors, strict=True):
        assert descriptor.description.startswith(parameter.description)
        assert descriptor.read_only == (not parameter.live)
    ways = {("topic", "publish"): node.get_publisher_names_and_types_by_node,
            ("topic", "subscribe"): node.get_subscriber_names_and_types_by_node,
            ("service", "reply"): node.get_service_names_and_types_by_node,
            ("service", "request"): node.get_client_names_and_types_by_node}
    for way, find in ways.items():
        done = {f"/{full.removeprefix(f'{namespace}/').lstrip('/')}" for full, _ in find(name, namespace)}
        assert done <= allowed.get((f"/srt3d/{name}", *way), set()), way


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


def test_only_the_operator_may_change_anything(allowed):
    for (enclave, kind, verb), names in allowed.items():
        if (kind, verb) == ("service", "request") and enclave != "/srt3d/operator":
            assert {name.split("/")[-1] for name in names} == {"get_parameters", "list_parameters"}, enclave
    for spec in SPECS.values():
        for service in ("set_parameters", "change_state", *spec.services):
            assert f"/{spec.name}/{service}" in allowed["/srt3d/operator", "service", "request"]


def test_one_process_may_what_its_nodes_may(allowed):
    for kind, verb in KINDS:
        of_nodes = (allowed.get((f"/srt3d/{name}", kind, verb), set()) for name in SPECS)
        assert allowed["/srt3d/all", kind, verb] == set().union(*of_nodes)
