"""The lifecycle node that the package's nodes are made from."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.ros.base import exception_guards
from tactile_localizer.ros.base.background_task import in_background
from tactile_localizer.ros.base.parameters import Parameter, Parameters
from tactile_localizer.ros.base.rclpy_private import withdraw_lifecycle_services

_AUTOSTART = Parameter(
    "autostart", True, "Configure and activate at start; false leaves that to a lifecycle manager"
)


class ManagedNode(LifecycleNodeMixin, Node):
    """A lifecycle node whose transitions are four plain methods.

    A subclass overrides :meth:`configure`, :meth:`activate`, :meth:`deactivate` and :meth:`cleanup`. The
    first two refuse by raising a :class:`TactileLocalizerError`: the node logs its one line and stays in the
    state that it was in. The last two must bear being called when nothing, or only a part, was made.

    :meth:`configure` may take seconds: it runs in a thread, and the node's services answer meanwhile. What
    :meth:`create_lifecycle_publisher` made publishes only while the node is active.

    Parameters
    ----------
    name : the node's name
    declared : its parameters, beside ``autostart``
    threads : callbacks that may run at once. More than one needs callback groups
    """

    def __init__(
        self, name: str, declared: Sequence[Parameter] = (), threads: int = 1, **kwargs: Any
    ) -> None:
        Node.__init__(self, name, **kwargs)
        LifecycleNodeMixin.__init__(self, callback_group=ReentrantCallbackGroup())
        self._is_configured = False
        self._changing = threading.Lock()
        self.threads = threads
        for service in self.services:
            if service.srv_type is ChangeState:
                self._change_state, service.callback = service.callback, self._on_change_state
        try:
            self.parameters = Parameters(self, (_AUTOSTART, *declared), lambda: self._is_configured)
        except TactileLocalizerError:
            self.destroy_node()  # nobody else has it
            raise

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **options: Any) -> Service:
        """A service that answers with a refusal whatever its callback raises."""
        answer = exception_guards.refusing(self, srv_name, srv_type, callback)
        return super().create_service(srv_type, srv_name, answer, **options)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *quality: Any, **options: Any
    ) -> Subscription:
        """A subscription that drops a message whatever its callback raises."""
        work = exception_guards.dropping(self, topic, callback)
        return super().create_subscription(msg_type, topic, work, *quality, **options)

    def create_timer(self, timer_period_sec: float, callback: Any, *clock: Any, **options: Any) -> Timer:
        """A timer that goes on whatever its callback raises."""
        work = exception_guards.dropping(self, "timer", callback)
        return super().create_timer(timer_period_sec, work, *clock, **options)

    def configure(self) -> None:
        """Read the parameters and make everything that is needed."""

    def activate(self) -> None:
        """Begin the work."""

    def deactivate(self) -> None:
        """End the work; threads are joined."""

    def cleanup(self) -> None:
        """Let go of what :meth:`configure` made."""

    async def start(self) -> bool:
        """Configure and activate, while the executor goes on; whether both went well."""
        with self._changing:
            return (
                await in_background(self, self.trigger_configure) == TransitionCallbackReturn.SUCCESS
                and self.trigger_activate() == TransitionCallbackReturn.SUCCESS
            )

    def close(self) -> None:
        """End the work and let go of everything, whatever the state; for the end of the process."""
        self.deactivate()
        self.cleanup()

    def destroy_node(self) -> None:
        """Leave the graph at once, with the lifecycle services, which rclpy's state machine would keep."""
        super().destroy_node()
        withdraw_lifecycle_services(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to inactive, or refuse."""
        self._is_configured = True
        answer = self._attempt(self.configure, undo=self.cleanup)
        for parameter in self.parameters.strange():
            self.get_logger().warning(f"parameter {parameter}: expected one of this node's, it is ignored")
        self._is_configured = answer == TransitionCallbackReturn.SUCCESS
        return answer

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to active, or refuse."""
        super().on_activate(state)
        answer = self._attempt(self.activate, undo=self.deactivate)
        if answer != TransitionCallbackReturn.SUCCESS:
            super().on_deactivate(state)
        return answer

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to inactive."""
        answer = self._attempt(self.deactivate)
        super().on_deactivate(state)
        return answer

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to unconfigured."""
        self._is_configured = False
        return self._attempt(self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to finalized, from any state."""
        self._is_configured = False
        return self._attempt(self.close)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After an unexpected failure: back to unconfigured."""
        self._is_configured = False
        return self._attempt(self.close)

    async def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Change the state, or say that it cannot be changed; rclpy would let the node die of that."""
        wanted = request.transition
        if not self._changing.acquire(blocking=False):
            self.get_logger().error(f"transition {wanted.label or wanted.id}: expected no other under way")
            return response
        try:
            change = partial(self._change_state, request, response)
            if wanted.label == "configure" or wanted.id == Transition.TRANSITION_CONFIGURE:
                return await in_background(self, change)
            return change()
        except RuntimeError as error:  # rclpy's own, of a transition that the state does not have
            self.get_logger().error(f"transition {wanted.label or wanted.id}: {str(error).splitlines()[0]}")
            return response
        finally:
            self._changing.release()

    def _attempt(
        self, work: Callable[[], None], undo: Callable[[], None] | None = None
    ) -> TransitionCallbackReturn:
        try:
            work()
        except Exception as error:  # rclpy would swallow what is unexpected without a word
            self.get_logger().error(exception_guards.in_one_line(error))
            if undo is None:
                return TransitionCallbackReturn.ERROR
            undo()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS
