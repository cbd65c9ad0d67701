"""A node's page in the documentation, from its interface."""

import textwrap
from collections.abc import Iterable

from srt3d_ros.nodes.books import FRAMES
from srt3d_ros.nodes.interface import Interface, Topic
from srt3d_ros.nodes.parameters import Parameter, yaml_value
from srt3d_ros.nodes.topics import DIAGNOSTICS

WIDTH = 120
MADE_BY = "<!-- Made by python -m srt3d_ros.nodes.tables from the node's own table: change it there. -->"
MANAGED = """\
`~/change_state`, `~/get_state` and the others of a managed node: `ros2 lifecycle set /{name} deactivate` stops the
work, `activate` goes on. The node configures and activates itself unless `autostart` is false."""
QUALITY = """\
Relative names can be remapped, and take the namespace in which the node is started. QoS is reliable; latched topics are
also transient local, depth 1. It can be set for every topic, as in
`-p qos_overrides./{topic}.{end}.reliability:=best_effort`, with the topic's full name after remapping; `history`,
`depth` and `durability` likewise."""
LEVELS = """\
Once a second, whatever the subscribers; totals count from the start and never fall. ERROR: something failed that should
not have, the books do not balance, two inputs contradict each other, or more than half of the last second's frames were
dropped or lost. WARN: a frame was dropped (each cause is counted as `dropped.<cause>`) or lost on the way here
(`message_lost`), `use_sim_time` is true and there is no /clock, the node waits for something, no frame came for 2 s, or
the last second's frames left more than 2 s old or were stamped more than 0.5 s ahead of the node's clock (median). OK
otherwise. The percentiles of the latency are those of the newest 200 frames."""
BOOKS = """\
In every report, the last one included, which a node publishes as `finalized` when it is told to end:

{equations}

What is under way {where}. Whenever nothing is in hand, the node counts what
really waits; what has gone astray in spite of all is unaccounted for: 0, or a mistake of this package. What was lost on
the way here (`message_lost`) never came in: from the first message on, the sender sent `frames_in` + `message_lost`."""


def page(interface: Interface) -> str:
    """The page in Markdown: Purpose, Inputs, Outputs, Services, Parameters, Diagnostics, Limits."""
    parts = [
        f"# {interface.name}", MADE_BY,
        "## Purpose", textwrap.fill(interface.purpose, WIDTH), f"    ros2 run srt3d_ros {interface.name}",
        "## Inputs", _topics(interface.inputs),
        "## Outputs", _topics((*interface.outputs, DIAGNOSTICS)),
        QUALITY.format(topic=_example(interface), end="subscription" if interface.inputs else "publisher"),
        "## Services", _services(interface),
        "## Parameters", _parameters(interface.table),
        "## Diagnostics", LEVELS, _books(interface),
        *(["## Limits", "\n".join(f"* {limit}" for limit in interface.limits)] if interface.limits else []),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _example(interface: Interface) -> str:
    """A topic whose QoS somebody may want to change: the last one that carries frames."""
    return [topic.name for topic in (*interface.outputs, *interface.inputs) if topic.name[0] != "/"][-1]


def _topics(topics: Iterable[Topic]) -> str:
    rows = [(f"`{topic.name}`", f"`{topic.type_name}`", topic.about + (", latched" if topic.latched else "")
             + (f"; {topic.when}" if topic.when else "")) for topic in topics]
    return _table(("topic", "type", "what"), rows) if rows else "None."


def _services(interface: Interface) -> str:
    rows = [(f"`~/{service.name}`", "`std_srvs/srv/Trigger`", service.about) for service in interface.services]
    listed = [_table(("service", "type", "what it does"), rows)] if rows else []
    return "\n\n".join([*listed, MANAGED.format(name=interface.name)])


def _parameters(table: Iterable[Parameter]) -> str:
    rows = [(f"`{parameter.name}`", f"`{yaml_value(parameter.default)}`", parameter.expected,
             "live" if parameter.live else "at start", parameter.description) for parameter in table]
    return _table(("name", "default", "value", "changes", "what"), rows)


def _books(interface: Interface) -> str:
    books = tuple(interface.books)
    return BOOKS.format(equations="\n".join(f"    {balance}" for balance in books),
                        where="waits or is in hand" if books == (FRAMES,) else "waits, is in hand or in the open frame")


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
