"""What a running node offers to the graph is what its spec says, and it goes on whatever its parameters are set to."""

from pathlib import Path

import pytest
import yaml
from rcl_interfaces.srv import DescribeParameters, ListParameters

from srt3d_ros.datasets import open_sensor
from srt3d_ros.nodes import all_specs

OF_EVERY_NODE = ("/rosout", "/parameter_events", "/diagnostics")
OF_MANAGED_NODES = ("change_state", "get_state", "get_available_states", "get_available_transitions",
                    "get_transition_graph", "transition_event", "describe_parameters", "get_parameter_types",
                    "get_parameters", "list_parameters", "set_parameters", "set_parameters_atomically",
                    "get_type_description")
LIVE_TEXTS = {"frequencies", "frame_id", "gate"}       # without choices; none is a path
NEVER_TOGETHER = {"player": {"odom", "/clock"}, "sketcher": {"odom", "imu"}, "reconstructor": {"odom"}}


def values_of(parameter) -> list:
    """All values of a choice, both ends of a range, and what lies beyond them."""
    kind = type(parameter.default)
    if kind in (bool, str):
        return [*(parameter.choices or {bool: (True, False), str: ("x", "1-90", "1,2,5")}[kind])]
    low, high = (kind(instead if end is None else end) for end, instead in (
        (parameter.low, -1e9), (parameter.high, 1e9)))
    return [low, high, low - 1, high + 1]


@pytest.fixture(scope="module")
def graph(shared_graph, photon_file, tmp_path_factory):
    """All nodes, at work."""
    shared_graph.start("recorder", path=tmp_path_factory.mktemp("recorder") / "a.rrd").ready()
    shared_graph.start("reconstructor").ready()
    shared_graph.start("sketcher", sensor_file=photon_file).ready()
    shared_graph.start("player", input=photon_file, rate_hz=20.0).ready()
    return shared_graph


@pytest.mark.parametrize("name", all_specs())
def test_topics_and_parameters_are_those_of_the_spec(graph, name):
    spec, never = all_specs()[name], NEVER_TOGETHER.get(name, set())

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
        assert descriptor.read_only == (not (parameter.live or parameter.inactive))
    graph.reports(name, "hardware_id", f"{namespace[1:]}/lidar")        # which tells sensors apart


@pytest.mark.parametrize("name", all_specs())
def test_a_running_node_takes_or_refuses_both_ends_of_each_range_and_goes_on(graph, name):
    done = {"player": ["frames_out"], "reconstructor": ["frames_out", "dropped.malformed"]}.get(name, ["messages_in"])
    for parameter in all_specs()[name].table:
        for value in [*values_of(parameter), parameter.default]:
            reason = graph.set(name, **{parameter.name: value})
            assert "internal" not in reason, (value, reason)
            assert bool(reason) == (not parameter.live) if value == parameter.default else parameter.live or reason
            before = sum(graph.total(name, key) for key in done)
            graph.wait(lambda before=before: not parameter.live or sum(graph.total(name, key) for key in done)
                       > before + 1, "frames with that value")
    assert graph.total(name, "internal") == 0, graph.report(name)


@pytest.mark.parametrize("name", all_specs())
def test_no_one_on_the_network_can_make_a_node_read_or_replace_a_file(name):
    for parameter in all_specs()[name].table:
        if parameter.inactive:
            assert (name, parameter.name) == ("recorder", "path")      # a recorder replaces no file
        if parameter.live and isinstance(parameter.default, str) and not parameter.choices:
            assert parameter.name in LIVE_TEXTS and "path" not in parameter.form and "folder" not in parameter.form


CONFIG = Path(__file__).resolve().parents[2] / "config"
PRESETS = [path for path in sorted(CONFIG.glob("*.yaml")) if path.stem != "srt3d"]
MESSAGE_MB = 32         # of `photons`, `gates` or `sketch`: what the shared memory between two nodes is made for


@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_values_are_of_parameters_that_take_them_and_suit_the_sensor_of_the_same_name(preset):
    settings = {key.removeprefix("/**/"): content["ros__parameters"]
                for key, content in yaml.safe_load(preset.read_text()).items()}
    for node, values in settings.items():
        table = {parameter.name: parameter for parameter in all_specs()[node].table}
        assert all(table[name].check(value) == value for name, value in values.items())
    sensor, sketcher = open_sensor(preset.with_name("sensors") / f"{preset.stem}.json"), settings["sketcher"]
    assert preset.stem.split("_")[1] == f"{sensor.rows}x{sensor.cols}"
    assert (sensor.gates is not None) == preset.stem.endswith("gates")
    number_bytes = 2 if sketcher.get("layout") == "int16" else 4
    assert sensor.pixels * (4 + 2 * sketcher["sketch_size"] * number_bytes) < MESSAGE_MB * 2**20
