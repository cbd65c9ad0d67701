"""What a running node offers to the graph is what its spec says."""


import pytest
from rcl_interfaces.srv import DescribeParameters, ListParameters

from srt3d_ros.nodes import all_specs

OF_EVERY_NODE = ("/rosout", "/parameter_events", "/diagnostics")
OF_MANAGED_NODES = ("change_state", "get_state", "get_available_states", "get_available_transitions",
                    "get_transition_graph", "transition_event", "describe_parameters", "get_parameter_types",
                    "get_parameters", "list_parameters", "set_parameters", "set_parameters_atomically",
                    "get_type_description")
# Parameters with which a node has all its topics.
EVERYTHING = {"sketcher": {"sensor_file": "config/sensors/spad_32x32_gates.json", "motion": "odom"}}
NEVER_TOGETHER = {"player": {"odom"},
                  "sketcher": {"imu"}}


@pytest.fixture(params=all_specs())
def running(request, graph, photon_file, tmp_path):
    """A node that is ready, and its table."""
    name = request.param
    extra = {"player": {"input": photon_file}, "recorder": {"path": tmp_path / "out.rrd"}}.get(name, {})
    graph.start(name, **extra, **EVERYTHING.get(name, {})).ready()
    return name, all_specs()[name]


def test_topics_and_parameters_are_those_of_the_spec(graph, running):
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
    graph.wait(lambda: relative(node.get_subscriber_names_and_types_by_node(name, namespace))
               == declared(spec.inputs), "the inputs of the table")
    graph.wait(lambda: relative(node.get_publisher_names_and_types_by_node(name, namespace))
               == declared(spec.outputs), "the outputs of the table")
    graph.wait(lambda: not relative(node.get_service_names_and_types_by_node(name, namespace)), "no services")
    listed = graph.call(ListParameters, f"{name}/list_parameters", ListParameters.Request()).result.names
    of_ros = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    assert {one for one in listed if not one.startswith(of_ros)} == {one.name for one in spec.table}
    names = [parameter.name for parameter in spec.table]
    described = graph.call(DescribeParameters, f"{name}/describe_parameters", DescribeParameters.Request(names=names))
    for parameter, descriptor in zip(spec.table, described.descriptors, strict=True):
        assert descriptor.description.startswith(parameter.description)
        assert descriptor.read_only == (not parameter.live)
