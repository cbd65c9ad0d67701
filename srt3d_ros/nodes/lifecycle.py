"""ManagedNode: the transitions of a ROS 2 managed node as plain methods, any of which may raise."""

from collections.abc import Callable

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn


class ManagedNode(LifecycleNode):
    """A lifecycle node whose steps raise when they fail; the node then stays in the state in which it was.

    A node of its own overrides `configure` and `activate`, and what of `deactivate` and `cleanup` it needs. Each is
    called in the executor's thread. `state` is the label that `ros2 lifecycle get` shows.
    """

    def __init__(self, name: str, **options):
        super().__init__(name, **options)
        self.state = "unconfigured"
        self.problem: Exception | None = None       # why the last transition failed
        self._starting = False      # true in `start`, and after a `start` that failed
        self._refuse_impossible_transitions()

    def configure(self) -> None:
        """Open, compile, advertise."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Undo `activate`, also a half of it."""

    def cleanup(self) -> None:
        """Undo `configure`, also a half of it."""

    def refused(self, problem: Exception) -> None:
        """A transition that somebody else asked for failed."""

    def start(self) -> None:
        """Configure and activate; raises what they raise."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self.problem
        self._starting = False
        self._refuse_impossible_transitions()

    def on_configure(self, _) -> TransitionCallbackReturn:
        """`ros2 lifecycle set … configure`."""
        return self._step(self.configure, "inactive", "configured", self.cleanup)

    def on_activate(self, _) -> TransitionCallbackReturn:
        """`ros2 lifecycle set … activate`."""
        return self._step(self.activate, "active", "ready", self.deactivate)

    def on_deactivate(self, _) -> TransitionCallbackReturn:
        """`ros2 lifecycle set … deactivate`."""
        return self._step(self.deactivate, "inactive", "deactivated")

    def on_cleanup(self, _) -> TransitionCallbackReturn:
        """`ros2 lifecycle set … cleanup`."""
        return self._step(self.cleanup, "unconfigured", "cleaned up")

    def on_shutdown(self, _) -> TransitionCallbackReturn:
        """`ros2 lifecycle set … shutdown`: the node is of no more use; its process ends when it is told to."""
        if self.state == "active":
            self.deactivate()
        return self._step(self.cleanup, "finalized", "finalized")

    def _refuse_impossible_transitions(self) -> None:
        """Answer no. rclpy lets the exception for a transition that the state does not have end the process."""
        service = self._service_change_state
        change = service.callback

        def guarded(request, response):
            try:
                return change(request, response)
            except rclpy_implementation.RCLError:
                self.get_logger().warning(f"no such transition while {self.state}: {request.transition.label or ''}"
                                          f" ({request.transition.id})")
                response.success = False
                return response

        service.callback = guarded

    def _step(self, step: Callable[[], None], state: str, done: str, undo: Callable[[], None] = lambda: None):
        """Take a step; log `done` if somebody else asked for it: who calls `start` logs that."""
        try:
            step()
        except Exception as problem:
            self.problem = problem
            undo()
            if not self._starting:
                self.refused(problem)
            return TransitionCallbackReturn.FAILURE
        self.state = state
        if not self._starting:
            self.get_logger().info(done)
        return TransitionCallbackReturn.SUCCESS
