"""Make the tables of docs/nodes.md and config/srt3d.yaml from the specs of the nodes."""

import textwrap
from collections.abc import Iterable

import yaml

from srt3d_ros.nodes.common.parameters import Parameter, Value
from srt3d_ros.nodes.common.topics import DIAGNOSTICS, FRAMES, MOTION, NodeSpec, Topic
from tools.schema_tables import table

OUTSIDE = dict.fromkeys(("sensor", *(topic.name for topic in FRAMES)), "your driver") | {
    topic.name: "your robot" for topic in MOTION}
EVERY_NODE = "every node"


def nodes_tables(specs: Iterable[NodeSpec]) -> dict[str, str]:
    """The tables of docs/nodes.md by name: the topics of all nodes, and the parameters of each."""
    return {"topics": topics_table(specs)} | {spec.name: parameters_table(spec) for spec in specs}


def parameters_table(spec: NodeSpec) -> str:
    """A table of the parameters of a node. `autostart`, which all nodes have, is left to the page."""
    return table(("parameter", "default", "may be", "changes", "meaning"),
                 [(f"`{one.name}`", f"`{_yaml_value(one.default)}`", one.expected,
                   one.when, one.description) for one in spec.parameters])


def topics_table(specs: Iterable[NodeSpec]) -> str:
    """A table of all topics, with the nodes that publish each and those that read it."""
    specs = list(specs)
    topics = {topic.name: topic for spec in specs for topic in (*spec.inputs, *spec.outputs)} | {
        DIAGNOSTICS.name: DIAGNOSTICS}
    rows = [(f"`{topic.name}`", f"`{topic.type.replace('/msg/', '/')}`", topic.about + ", latched" * topic.latched,
             ", ".join(_publishers(topic, specs)),
             ", ".join(spec.name for spec in specs if topic.name in {one.name for one in spec.inputs}))
            for topic in topics.values()]
    return table(("topic", "type", "content", "published by", "read by"), rows)


def _publishers(topic: Topic, specs: list[NodeSpec]) -> list[str]:
    """Who publishes a topic: drivers or the robot, then nodes, each with its condition."""
    own = [spec.name + (f" ({one.when})" if one.when else "") for spec in specs for one in spec.outputs
           if one.name == topic.name]
    if topic.name in OUTSIDE:
        return [OUTSIDE[topic.name], *own]
    return own or [EVERY_NODE]


def as_yaml(tables: dict[str, Iterable[Parameter]]) -> str:
    """A commented parameter file with all defaults, for nodes of these names in any namespace."""
    lines = []
    for node, parameters in tables.items():
        lines += ["", f"/**/{node}:", "  ros__parameters:"]
        for parameter in parameters:
            expected = ", ".join(filter(None, (parameter.expected, parameter.when)))
            text = f"{parameter.description} [{expected}]"
            lines += textwrap.wrap(text, 116, initial_indent="    # ", subsequent_indent="    # ")
            lines.append(f"    {parameter.name}: {_yaml_value(parameter.default)}")
    return "\n".join(lines[1:]) + "\n"


def _yaml_value(value: Value) -> str:
    return yaml.safe_dump(value, default_style='"' if isinstance(value, str) else None, width=1000).splitlines()[0]
