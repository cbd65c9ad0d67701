"""The public interface of a node as one table. Its topics, services, parameters and reference page come from it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from srt3d_ros.nodes.frame_accounting import FRAMES, Balance
from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.topics import Topic

AUTOSTART = Parameter("autostart", True, "Configure and activate at the start; if false, a lifecycle manager does.")
LOSSLESS = Parameter("lossless", False, "Drop no frame: queue frames instead of keeping the newest, and wait for a "
                     "subscriber before publishing. For replays; a live sensor needs the newest frame.")


@dataclass(frozen=True)
class NodeSpec:
    """Everything that is public about a node, but for what every node has.

    Args:
        name: of the node and of its executable.
        services: what those of type std_srvs/srv/Trigger do, by name: a node serves them as `~/name`.
        limits: what a user has to know before relying on it, a sentence each.
        balances: the equations that its totals keep.
    """

    name: str
    purpose: str
    inputs: Iterable[Topic] = ()
    outputs: Iterable[Topic] = ()
    services: Mapping[str, str] = field(default_factory=dict)
    parameters: Iterable[Parameter] = ()
    limits: Iterable[str] = ()
    balances: Iterable[Balance] = (FRAMES,)

    @property
    def table(self) -> tuple[Parameter, ...]:
        """All parameters."""
        return (*self.parameters, AUTOSTART)

    def topic(self, name: str) -> Topic:
        """The input or output of this name."""
        return {topic.name: topic for topic in (*self.inputs, *self.outputs)}[name]
