"""What a node learns of the others in its namespace: their drops, their parameters, their log."""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.parameters import Value

FIRST_PATIENCE, PATIENCE = 2, 5     # an answer is lost where the node does not know who asked yet
_NOT_THEIR_OWN = ("qos_overrides.", "start_type_description_service")


def reports(message: DiagnosticArray, namespace: str) -> list[DiagnosticStatus]:
    """Those of the pipeline's nodes in this namespace."""
    begin = namespace.rstrip("/") + "/"
    return [status for status in message.status
            if status.hardware_id == PIPELINE_ID and f"/{status.name}".startswith(begin)]


def own_name(log: Log, namespace: str) -> str | None:
    """The name of the node in this namespace whose line it is; None if it is another's."""
    of, _, name = log.name.rpartition(".")
    return name if of == namespace.strip("/").replace("/", ".") else None


class Drops:
    """Frames dropped or lost by all nodes of a pipeline since this began; a node's restart does not set it back."""

    def __init__(self):
        self._latest: dict[str, int] = {}
        self.total = 0

    def add(self, message: DiagnosticArray, namespace: str) -> None:
        """Take in the reports of the pipeline's nodes in this namespace."""
        for status in reports(message, namespace):
            values = {pair.key: pair.value for pair in status.values}
            dropped = int(values["dropped"]) + int(values["message_lost"])
            before = self._latest.get(status.name, 0)
            self.total += dropped - before if dropped >= before else dropped
            self._latest[status.name] = dropped


class ParameterWatch:
    """Asks nodes once for their parameters, and follows the changes that they announce.

    Args:
        node: who asks.
        tell: called with {"node.parameter": value} in the executor's thread, or in that of `hear`.
    """

    def __init__(self, node: Node, tell: Callable[[dict[str, Value]], None]):
        self._node, self._tell = node, tell
        self._clients: dict[str, tuple] = {}
        self._patience: dict[str, int] = {}         # calls of `ask` until a node is asked again
        self._answered: set[str] = set()

    def ask(self, name: str) -> None:
        """Ask the node with this full name; to be called about once a second, before it answers and afterwards."""
        if name in self._answered:
            return
        if name not in self._clients:
            self._clients[name] = (self._node.create_client(ListParameters, f"{name}/list_parameters"),
                                   self._node.create_client(GetParameters, f"{name}/get_parameters"))
            self._patience[name] = FIRST_PATIENCE
        lister, getter = self._clients[name]
        self._patience[name] -= 1
        if self._patience[name] <= 0 and lister.service_is_ready() and getter.service_is_ready():
            self._patience[name] = PATIENCE
            lister.call_async(ListParameters.Request()).add_done_callback(
                lambda answer: self._get(name, getter, answer.result().result.names))

    def hear(self, event: ParameterEvent) -> None:
        """Take in a change that a node announces."""
        if event.node in self._answered:
            self._told(event.node, [(one.name, one.value) for one in (*event.new_parameters,
                                                                      *event.changed_parameters)])

    def _get(self, name: str, getter, names: list[str]) -> None:
        getter.call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda answer: self._got(name, list(zip(names, answer.result().values))))

    def _got(self, name: str, values: list) -> None:
        self._told(name, values)
        self._answered.add(name)
        for client in self._clients.pop(name, ()):
            self._node.destroy_client(client)

    def _told(self, name: str, values: list) -> None:
        node = name.rpartition("/")[2]
        self._tell({f"{node}.{parameter}": parameter_value_to_python(value) for parameter, value in values
                    if not parameter.startswith(_NOT_THEIR_OWN)})
