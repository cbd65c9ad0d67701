"""What a node learns of the other nodes in its namespace: drops, parameters, log lines."""

from collections import Counter
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from srt3d_ros.nodes.diagnostics import PIPELINE_ID
from srt3d_ros.nodes.parameters import Value

FIRST_CALL, CALLS_APART = 2, 5      # calls of `ask` until the first request, and between requests
_NOT_THEIR_OWN = ("qos_overrides.", "start_type_description_service")


def reports(message: DiagnosticArray, namespace: str) -> list[DiagnosticStatus]:
    """The reports of the pipeline's nodes in this namespace."""
    begin = namespace.rstrip("/") + "/"
    return [status for status in message.status
            if status.hardware_id == PIPELINE_ID and f"/{status.name}".startswith(begin)]


def own_name(log: Log, namespace: str) -> str | None:
    """The name of the node that logged a line; None if it is not in this namespace."""
    of, _, name = log.name.rpartition(".")
    return name if of == namespace.strip("/").replace("/", ".") else None


class Drops:
    """Frames dropped or lost by all nodes of a pipeline; the total does not fall when a node restarts."""

    def __init__(self):
        self._latest: dict[str, int] = {}
        self.total = 0

    def add(self, message: DiagnosticArray, namespace: str) -> None:
        """Add the reports of the pipeline's nodes in this namespace."""
        for status in reports(message, namespace):
            values = {pair.key: pair.value for pair in status.values}
            dropped = int(values["dropped"]) + int(values["message_lost"])
            before = self._latest.get(status.name, 0)
            self.total += dropped - before if dropped >= before else dropped
            self._latest[status.name] = dropped


class ParameterWatch:
    """Requests the parameters of nodes and follows the changes that they announce.

    A request is repeated until it is answered: a node's answer is lost while it does not know the client yet.

    Args:
        node: whose clients send the requests.
        on_values: called with {"node.parameter": value} in the executor's thread, or in that of `on_event`.
    """

    def __init__(self, node: Node, on_values: Callable[[dict[str, Value]], None]):
        self._node, self._on_values = node, on_values
        self._clients: dict[str, tuple] = {}
        self._calls: Counter[str] = Counter()
        self._answered: set[str] = set()

    def ask(self, name: str) -> None:
        """Request the parameters of the node with this full name; to be called about once a second."""
        if name in self._answered:
            return
        if name not in self._clients:
            self._clients[name] = (self._node.create_client(ListParameters, f"{name}/list_parameters"),
                                   self._node.create_client(GetParameters, f"{name}/get_parameters"))
        lister, getter = self._clients[name]
        self._calls[name] += 1
        if self._calls[name] >= FIRST_CALL and lister.service_is_ready() and getter.service_is_ready():
            self._calls[name] = FIRST_CALL - CALLS_APART
            lister.call_async(ListParameters.Request()).add_done_callback(
                lambda answer: self._get(name, getter, answer.result().result.names))

    def on_event(self, event: ParameterEvent) -> None:
        """Pass on a change that a node announces."""
        if event.node in self._answered:
            changes = (*event.new_parameters, *event.changed_parameters)
            self._pass_on(event.node, [(change.name, change.value) for change in changes])

    def _get(self, name: str, getter, names: list[str]) -> None:
        getter.call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda answer: self._got(name, list(zip(names, answer.result().values))))

    def _got(self, name: str, values: list) -> None:
        self._pass_on(name, values)
        self._answered.add(name)
        for client in self._clients.pop(name, ()):
            self._node.destroy_client(client)

    def _pass_on(self, name: str, values: list) -> None:
        node = name.rpartition("/")[2]
        self._on_values({f"{node}.{parameter}": parameter_value_to_python(value) for parameter, value in values
                    if not parameter.startswith(_NOT_THEIR_OWN)})
