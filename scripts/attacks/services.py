"""How to call a service on a busy machine without losing the answer."""

import time
from collections.abc import Callable

from rcl_interfaces.srv import ListParameters
from rclpy.node import Node

ASK_AGAIN_S = 1.0       # a question whose answer may have been lost


def become_known(node: Node, name: str, wait: Callable[[Callable[[], object], str], object]) -> None:
    """Return once another node has found the clients that `node` has made so far.

    An answer waits no more than 0.1 s for a client that its server has not found, and is lost then. Clients are found
    in the order in which they were made: who answers the newest, to what may be asked twice, has found them all.

    Args:
        name: of the other node, relative to the namespace of `node`.
        wait: returns once a condition holds; told what is waited for.
    """
    client = node.create_client(ListParameters, f"{name}/list_parameters")
    wait(client.service_is_ready, f"the parameters of {name}")
    began, answers = time.monotonic(), []

    def answered() -> bool:
        if time.monotonic() >= began + len(answers) * ASK_AGAIN_S:
            answers.append(client.call_async(ListParameters.Request()))
        return any(answer.done() for answer in answers)

    wait(answered, f"{name} to find its clients")
    node.destroy_client(client)
