"""What rclpy makes us patch, in Jazzy (7.1) to Lyrical (10): each goes when its function says."""

from contextlib import suppress
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

RCLError = rclpy_implementation.RCLError        # rclpy 7.1 exports it nowhere else


class PatchedLifecycleNode(LifecycleNode):
    """A LifecycleNode that answers requests for what it does not have; rclpy 7.1 to 10 raises in the callback."""

    def __init__(self, name: str, **options: Any):
        super().__init__(name, **options)
        self._refuse_impossible_transitions()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As in rclpy, but a parameter that does not exist gives a failed result.

        It can go when rclpy's service `set_parameters_atomically` catches the exception, as `set_parameters` does.
        """
        try:
            return super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

    def _refuse_impossible_transitions(self) -> None:
        """Answer impossible requests with a failure; rclpy ends the process if one gives a transition's number.

        It can go when `LifecycleNodeMixin.__on_change_state` catches RCLError of numbers, as it does of labels.
        """
        change, machine = self._service_change_state.callback, self._state_machine
        labels = {number: label for number, label, *_ in machine.transition_graph}

        def guarded(request: Any, response: Any) -> Any:
            asked = request.transition
            wanted, possible = asked.label or labels.get(asked.id, str(asked.id)), machine.available_transitions
            if any(wanted == label and (asked.label or asked.id == number) for number, label, *_ in possible):
                return change(request, response)
            self.get_logger().warning(f"no transition {wanted} while {machine.current_state[1]}")
            response.success = False
            return response

        self._service_change_state.callback = guarded


def spin_once(executor: Executor, timeout_s: float) -> None:
    """As `Executor.spin_once`, while other threads destroy subscriptions.

    It can go when rclpy skips a subscription that is destroyed before it is waited for (InvalidHandle).
    """
    with suppress(rclpy_implementation.InvalidHandle):
        executor.spin_once(timeout_sec=timeout_s)
