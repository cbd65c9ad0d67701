"""A node's page in the documentation and its parameter file, from its spec."""

import textwrap
from collections.abc import Iterable

from srt3d_ros.nodes.frame_accounting import FRAMES
from srt3d_ros.nodes.node_spec import NodeSpec
from srt3d_ros.nodes.parameters import Parameter, Value
from srt3d_ros.nodes.topics import DIAGNOSTICS, Topic

WIDTH = 120
MADE_BY = "<!-- Made by python -m tools.generate_docs from the node's own table: change it there. -->"
MANAGED = """\
`~/change_state`, `~/get_state` and the others of a managed node: `ros2 lifecycle set /{name} deactivate` stops the
work, `activate` goes on. The node configures and activates itself unless `autostart` is false."""
QUALITY = """\
Relative names can be remapped, and take the namespace in which the node is started. QoS is reliable; latched topics are
also transient local, and published with depth 1. It can be set for every topic, as in
`-p qos_overrides./{topic}.{end}.reliability:=best_effort`, with the topic's full name after remapping; `history`,
`depth` and `durability` likewise."""
LEVELS = """\
Once a second, whatever the subscribers; totals count from the start and never fall. ERROR: something failed that should
not have, frame accounting does not add up, two inputs contradict each other, or more than half of the last second's
frames were dropped or lost. WARN: a frame was dropped (each cause is counted as `dropped.<cause>`) or lost on the way
here (`message_lost`), `use_sim_time` is true and there is no /clock, the node waits for something, no frame came for 2
s, or the last second's frames left more than 2 s old or were stamped more than 0.5 s ahead of the node's clock
(median). OK otherwise. The percentiles of the latency are those of the newest 200 frames."""
ACCOUNTING = """\
In every report, the last one included, which a node publishes as `finalized` when it is told to end:

{equations}

What is under way {where}. Whenever nothing is in hand, the node counts what
really waits; what has gone astray in spite of all is unaccounted for: 0, or a mistake of this package. What was lost on
the way here (`message_lost`) never came in: from the first message on, the sender sent `frames_in` + `message_lost`."""


def page(spec: NodeSpec) -> str:
    """The page in Markdown: Purpose, Inputs, Outputs, Services, Parameters, Diagnostics, Limits."""
    parts = [
        f"# {spec.name}", MADE_BY,
        "## Purpose", textwrap.fill(spec.purpose, WIDTH), f"    ros2 run srt3d_ros {spec.name}",
        "## Inputs", _topics(spec.inputs),
        "## Outputs", _topics((*spec.outputs, DIAGNOSTICS)),
        QUALITY.format(topic=_example(spec), end="subscription" if spec.inputs else "publisher"),
        "## Services", _services(spec),
        "## Parameters", _parameters(spec.table),
        "## Diagnostics", LEVELS, _accounting(spec),
        *(["## Limits", "\n".join(f"* {limit}" for limit in spec.limits)] if spec.limits else []),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _example(spec: NodeSpec) -> str:
    """A topic whose QoS somebody may want to change: the last one that carries frames."""
    return [topic.name for topic in (*spec.outputs, *spec.inputs) if topic.name[0] != "/"][-1]


def _topics(topics: Iterable[Topic]) -> str:
    rows = [(f"`{topic.name}`", f"`{topic.type_name}`", topic.about + (", latched" if topic.latched else "")
             + (f"; {topic.when}" if topic.when else "")) for topic in topics]
    return _table(("topic", "type", "what"), rows) if rows else "None."


def _services(spec: NodeSpec) -> str:
    rows = [(f"`~/{service.name}`", "`std_srvs/srv/Trigger`", service.about) for service in spec.services]
    listed = [_table(("service", "type", "what it does"), rows)] if rows else []
    return "\n\n".join([*listed, MANAGED.format(name=spec.name)])


def _parameters(table: Iterable[Parameter]) -> str:
    rows = [(f"`{parameter.name}`", f"`{_yaml_value(parameter.default)}`", parameter.expected,
             "live" if parameter.live else "at start", parameter.description) for parameter in table]
    return _table(("name", "default", "value", "changes", "what"), rows)


def _accounting(spec: NodeSpec) -> str:
    balances = tuple(spec.balances)
    return ACCOUNTING.format(equations="\n".join(f"    {balance}" for balance in balances),
                             where="waits or is in progress" if balances == (FRAMES,) else
                             "waits, is in progress or in the open frame")


def as_yaml(tables: dict[str, Iterable[Parameter]]) -> str:
    """A parameter file with every default, commented, for nodes of these names in any namespace."""
    lines = []
    for node, table in tables.items():
        lines += ["", f"/**/{node}:", "  ros__parameters:"]
        for parameter in table:
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


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
