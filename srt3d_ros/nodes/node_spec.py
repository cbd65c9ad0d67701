"""The public interface of a node as one table. Its topics, services and parameters come from it."""

from collections.abc import Iterable
from dataclasses import dataclass

from srt3d_ros.nodes.parameters import Parameter
from srt3d_ros.nodes.topics import Topic

AUTOSTART = Parameter("autostart", True, "true: configure and activate at the start. false: a lifecycle manager does.")


@dataclass(frozen=True)
class NodeSpec:
    """Everything that is public about a node, but for what every node has.

    Args:
        name: of the node and of its executable.
        services: names of each std_srvs/srv/Trigger that it serves as `~/name`.
    """

    name: str
    inputs: Iterable[Topic] = ()
    outputs: Iterable[Topic] = ()
    services: Iterable[str] = ()
    parameters: Iterable[Parameter] = ()

    @property
    def table(self) -> tuple[Parameter, ...]:
        """All parameters."""
        return (*self.parameters, AUTOSTART)

    def topic(self, name: str) -> Topic:
        """The input or output of this name."""
        return {topic.name: topic for topic in (*self.inputs, *self.outputs)}[name]
