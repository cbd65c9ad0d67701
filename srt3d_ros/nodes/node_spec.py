"""What a node offers to the graph, from one table: its topics and services are made from it, and so is its page."""

from collections.abc import Iterable
from dataclasses import dataclass

from srt3d_ros.nodes.frame_accounting import FRAMES, Balance
from srt3d_ros.nodes.parameters import Parameter

AUTOSTART = Parameter("autostart", True, "Configure and activate at the start; if false, somebody else does.")
LOSSLESS = Parameter(
    "lossless", False, "Drop no frame: queue frames instead of keeping the newest, and publish to nobody but wait for "
    "a subscriber. For replays; a live sensor needs the newest frame.")


@dataclass(frozen=True)
class Topic:
    """A topic that a node subscribes to or publishes.

    Args:
        name: relative, so that namespaces and remappings apply.
        type: the message's class.
        about: what is in it, in a few words.
        latched: reliable and transient local: who subscribes later still gets the last message.
        when: under what condition it is there; always if empty.
    """

    name: str
    type: type
    about: str
    latched: bool = False
    when: str = ""

    @property
    def type_name(self) -> str:
        """As `ros2 topic list -t` writes it."""
        return f"{self.type.__module__.split('.')[0]}/msg/{self.type.__name__}"


@dataclass(frozen=True)
class Service:
    """A std_srvs/srv/Trigger that a node serves under its own name, `~/name`."""

    name: str
    about: str


@dataclass(frozen=True)
class NodeSpec:
    """Everything that is public about a node.

    Args:
        name: of the node and of its executable.
        purpose: what it is for, one paragraph.
        inputs, outputs: topics; /diagnostics is every node's output and is not named here.
        services: beside those of every managed node.
        parameters: its own; those of every node are in `table`.
        limits: what a user has to know before relying on it, a sentence each.
        balances: the equations that its totals keep.
    """

    name: str
    purpose: str
    inputs: Iterable[Topic] = ()
    outputs: Iterable[Topic] = ()
    services: Iterable[Service] = ()
    parameters: Iterable[Parameter] = ()
    limits: Iterable[str] = ()
    balances: Iterable[Balance] = (FRAMES,)

    @property
    def table(self) -> tuple[Parameter, ...]:
        """All parameters."""
        return (*self.parameters, AUTOSTART)

    def topic(self, name: str) -> Topic:
        """The input or output of this name; KeyError if the table has none."""
        return {topic.name: topic for topic in (*self.inputs, *self.outputs)}[name]
