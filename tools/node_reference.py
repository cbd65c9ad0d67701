"""docs/nodes.md, the reference page of all nodes, from their specs."""

import textwrap
from collections.abc import Iterable

from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter, Value
from srt3d_ros.nodes.topics import DIAGNOSTICS, FRAMES, MOTION, Topic
from tools.schema_tables import table

WIDTH = 120
OUTSIDE = dict.fromkeys(("sensor", "sensor/camera_info", *(topic.name for topic in FRAMES)), "your driver") | {
    topic.name: "your robot" for topic in MOTION}
EVERY_NODE = "every node"
HEAD = """\
# The nodes

<!-- Made by python -m tools.generate_docs from the specs in srt3d_ros/nodes: change those. -->

`ros2 run srt3d_ros NODE` or `srt3d node NODE` starts one node; `srt3d up` and `ros2 launch` start all of them
([how](robot-stack.md#start)). [config/srt3d.yaml](../config/srt3d.yaml) lists every parameter with its default."""
QUALITY = """\
Relative names can be remapped, and take the namespace in which the node is started. QoS is reliable; latched topics are
also transient local with depth 1. A parameter overrides the QoS of a topic, by its full name after remapping:
`-p qos_overrides./points.publisher.reliability:=best_effort`; likewise `subscription`, and `history`, `depth` and
`durability`. [msg_schemas](../msg_schemas/README.md) has the byte tables of the messages."""
MANAGED = """\
All nodes are managed (lifecycle): `ros2 lifecycle set /sketcher deactivate` stops a node's work, `activate` resumes it.
A node configures and activates itself unless `autostart` is false. "live" parameters can be changed while the node
runs (`ros2 param set`) and take effect between frames; the others are fixed at the start."""
LEVELS = """\
Every node reports once a second. Totals count from the start of the node and never fall; the percentiles of the latency
are those of the newest 200 frames.

| level | when |
| --- | --- |
| ERROR | something failed that should not have; the frame accounting does not add up; \
two inputs contradict each other; more than half of the last second's frames were dropped or lost |
| WARN | a frame was dropped (counted by cause as `dropped.<cause>`) or lost on the way here (`message_lost`); \
`use_sim_time` is true and there is no /clock; the node waits for something; no frame came for 2 s; the last second's \
frames left more than 2 s old, or were stamped more than 0.5 s ahead of the node's clock (median) |
| OK | otherwise |

These equations hold in every report, also in the last one, which a node publishes with the state `finalized`:"""
ACCOUNTING = """\
`under_way` frames are in a queue, being processed or, in the sketcher, part of the open frame. Whenever no frame is
being processed, the node compares the totals with its queues. What is missing there is unaccounted for: 0, or a bug of
this package. `message_lost` counts messages that the middleware lost before the node; they are not in `frames_in`."""


def page(specs: Iterable[NodeSpec]) -> str:
    """The page in Markdown: topics, what all nodes have in common, then each node's services, parameters and limits."""
    specs = list(specs)
    shared = _shared(specs)
    parts = [HEAD, "## Topics", _topics(specs), QUALITY, "## Every node", MANAGED, _parameters(shared, specs),
             "## Diagnostics", LEVELS, _equations(specs), ACCOUNTING]
    for spec in specs:
        parts += _node(spec, shared)
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def _node(spec: NodeSpec, shared: Iterable[Parameter]) -> list[str]:
    """The section of one node."""
    lines = [*(f"* Service `~/{name}` (`std_srvs/srv/Trigger`): {about}." for name, about in spec.services.items()),
             *(f"* {limit}" for limit in spec.limits)]
    return [f"## {spec.name}", textwrap.fill(spec.purpose, WIDTH, break_long_words=False, break_on_hyphens=False),
            _parameters(parameter for parameter in spec.table if parameter not in shared),
            "\n".join(lines)]


def _shared(specs: list[NodeSpec]) -> list[Parameter]:
    """The parameters that several nodes have, the same in each."""
    everything = [parameter for spec in specs for parameter in spec.table]
    return list(dict.fromkeys(parameter for parameter in everything if everything.count(parameter) > 1))


def _topics(specs: list[NodeSpec]) -> str:
    """Each topic once, with the nodes that publish it and those that subscribe to it."""
    topics = {topic.name: topic for spec in specs for topic in (*spec.inputs, *spec.outputs)} | {
        DIAGNOSTICS.name: DIAGNOSTICS}
    rows = [(f"`{topic.name}`", f"`{topic.type}`", topic.about + ", latched" * topic.latched,
             ", ".join(_publishers(topic, specs)),
             ", ".join(spec.name for spec in specs if topic.name in {one.name for one in spec.inputs}))
            for topic in topics.values()]
    return table(("topic", "type", "content", "published by", "read by"), rows)


def _publishers(topic: Topic, specs: list[NodeSpec]) -> list[str]:
    """The nodes that publish a topic, each with its condition, and who else does."""
    own = [spec.name + (f" ({one.when})" if one.when else "") for spec in specs for one in spec.outputs
           if one.name == topic.name]
    if topic.name in OUTSIDE:
        return [OUTSIDE[topic.name], *own]
    return own or [EVERY_NODE]


def _parameters(parameters: Iterable[Parameter], specs: Iterable[NodeSpec] = ()) -> str:
    """A table of parameters; with `specs`, also of the nodes that have each."""
    rows = [(f"`{parameter.name}`", *_owners(parameter, specs), f"`{_yaml_value(parameter.default)}`",
             parameter.expected, "live" if parameter.live else "at start", parameter.description)
            for parameter in parameters]
    return table(("parameter", *(("nodes",) if specs else ()), "default", "value", "changes", "what it does"), rows)


def _owners(parameter: Parameter, specs: Iterable[NodeSpec]) -> tuple[str, ...]:
    owners = [spec.name for spec in specs if parameter in spec.table]
    return (", ".join(owners),) if owners else ()


def _equations(specs: list[NodeSpec]) -> str:
    """The equations of the frame accounting, with the nodes that keep them."""
    balances = dict.fromkeys(balance for spec in specs for balance in spec.balances)
    return "\n".join(f"    {balance}    ({', '.join(spec.name for spec in specs if balance in spec.balances)})"
                     for balance in balances)


def as_yaml(tables: dict[str, Iterable[Parameter]]) -> str:
    """A parameter file with every default, commented, for nodes of these names in any namespace."""
    lines = []
    for node, parameters in tables.items():
        lines += ["", f"/**/{node}:", "  ros__parameters:"]
        for parameter in parameters:
            text = f"{parameter.description} [{parameter.expected}{', live' * parameter.live}]"
            lines += textwrap.wrap(text, 116, initial_indent="    # ", subsequent_indent="    # ")
            lines.append(f"    {parameter.name}: {_yaml_value(parameter.default)}")
    return "\n".join(lines[1:]) + "\n"


def _yaml_value(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text     # YAML's floats need the dot
