"""Base class of the nodes: a lifecycle node whose transitions are plain methods."""

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeVar

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from tactile_localizer.errors import LiveError
from tactile_localizer.ros.base import exception_guards
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.parameters import Parameter, Parameters

T = TypeVar("T")

_BETWEEN_TRANSITIONS_S = 0.2
"""Time that a request waits for the end of the previous transition before it is rejected, s."""
_AUTOSTART = Parameter(
    "autostart", True, "Configure and activate at start; if false, a lifecycle manager does"
)


class ManagedNode(LifecycleNodeMixin, Node):
    """A lifecycle node that destroys what each transition created.

    A subclass overrides :meth:`configure` and :meth:`activate`. They reject the transition by raising a
    :class:`TactileLocalizerError`: the node logs it in one line and stays in its state. Publishers,
    subscriptions, services and timers that :meth:`configure` creates are destroyed on cleanup, those that
    :meth:`activate` creates on deactivation, the newest first. :meth:`defer` adds other resources.

    :meth:`configure` may take seconds: it runs in a thread, and the services of the node stay responsive.
    Publishers made by :meth:`create_lifecycle_publisher` publish only while the node is active.

    Parameters
    ----------
    name : name of the node
    declared : parameters of the node in addition to ``autostart``

    Attributes
    ----------
    is_active : whether the node is active, or being activated
    """

    def __init__(self, name: str, declared: Sequence[Parameter] = (), **kwargs: Any) -> None:
        self._configured, self._activated = ExitStack(), ExitStack()
        self._scope: ExitStack | None = None
        self._scope_thread = 0
        Node.__init__(self, name, **kwargs)
        LifecycleNodeMixin.__init__(self, callback_group=ReentrantCallbackGroup())
        self._is_configured = False
        self.is_active = False
        self._in_transition = threading.Lock()
        # rclpy makes this service neither with create_service nor with a method that could be overridden; its
        # callback is public, and there it is guarded, and may answer after a transition of seconds.
        service = next(service for service in self.services if service.srv_type is ChangeState)
        self._change_state = service.callback
        service.callback = exception_guards.guard_service(self, "state", ChangeState, self._on_change_state)
        try:
            self.parameters = Parameters(self, (_AUTOSTART, *declared), lambda: self._is_configured)
        except Exception:
            self.destroy_node()  # the caller never gets a reference to it
            raise

    def create_publisher(self, *arguments: Any, **options: Any) -> Publisher:
        """A publisher that also publishes while the node is inactive.

        It does not report incompatible subscriptions: each event that the executor waits for delays every
        message.
        """
        options.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        publisher = super().create_publisher(*arguments, **options)
        return self._owned(publisher, self.destroy_publisher)

    def create_lifecycle_publisher(self, *arguments: Any, **options: Any) -> Publisher:
        """A publisher that publishes only while the node is active; else as :meth:`create_publisher`."""
        options.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        publisher = super().create_lifecycle_publisher(*arguments, **options)
        return self._owned(publisher, self.destroy_lifecycle_publisher)

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **options: Any) -> Service:
        """A service that rejects the request if its callback raises an exception."""
        guarded = exception_guards.guard_service(self, srv_name, srv_type, callback)
        service = super().create_service(srv_type, srv_name, guarded, **options)
        return self._owned(service, self.destroy_service)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, *qos: Any, **options: Any
    ) -> Subscription:
        """A subscription that drops the message if its callback raises an exception.

        As :meth:`create_publisher`, it does not report incompatible publishers; best effort matches all.
        """
        options.setdefault("event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False))
        guarded = exception_guards.guard_callback(self, topic, callback)
        subscription = super().create_subscription(msg_type, topic, guarded, *qos, **options)
        return self._owned(subscription, self.destroy_subscription)

    def create_timer(self, timer_period_sec: float, callback: Callable[[], None]) -> Timer:
        """A timer of real time that continues if its callback raises an exception."""
        guarded = exception_guards.guard_callback(self, "timer", callback)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        return self._owned(super().create_timer(timer_period_sec, guarded, clock=steady), self.destroy_timer)

    @property
    def now_ns(self) -> int:
        """Time of the clock of the node, ns; 0 while simulated time has not started."""
        return int(self.get_clock().now().nanoseconds)

    def defer(self, release: Callable[[], Any]) -> None:
        """Call ``release`` when the transition in progress is undone, also if it fails.

        Without effect outside transitions.
        """
        if self._scope is not None and self._scope_thread == threading.get_ident():
            self._scope.callback(release)

    def _owned(self, entity: T, destroy: Callable[[T], Any]) -> T:
        """The entity, which is destroyed when the transition in progress is undone."""
        self.defer(partial(destroy, entity))
        return entity

    def configure(self) -> None:
        """Read the parameters and create the resources of an inactive node."""

    def activate(self) -> None:
        """Start working."""

    async def start(self) -> bool:
        """Configure and activate while the executor runs; returns whether both succeeded."""
        with self._in_transition:
            return (
                await run_in_thread(self, self.trigger_configure) == TransitionCallbackReturn.SUCCESS
                and self.trigger_activate() == TransitionCallbackReturn.SUCCESS
            )

    def close(self) -> None:
        """Stop working and release all resources, from any state, at the end of the process."""
        self.is_active = False
        self._activated.close()
        self._configured.close()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to inactive, unless :meth:`configure` fails."""
        self._is_configured = True
        result = self._attempt(self.configure, self._configured)
        for parameter in self.parameters.undeclared():
            self.get_logger().warning(f"parameter {parameter}: not a parameter of this node, ignored")
        self._is_configured = result == TransitionCallbackReturn.SUCCESS
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to active, unless :meth:`activate` fails."""
        super().on_activate(state)
        self.is_active = True
        result = self._attempt(self.activate, self._activated)
        if result != TransitionCallbackReturn.SUCCESS:
            self.is_active = False
            super().on_deactivate(state)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to inactive."""
        self.is_active = False
        result = self._try(self._activated.close)
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to unconfigured."""
        self._is_configured = False
        return self._try(self._configured.close)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition from any state to finalized; after an unexpected failure, to unconfigured."""
        self._is_configured = False
        return self._try(self.close)

    on_error = on_shutdown

    async def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Change the state; configuring may take seconds, in a thread."""
        change, wanted = partial(self._change, request, response), request.transition
        if wanted.label == "configure" or wanted.id == Transition.TRANSITION_CONFIGURE:
            return await run_in_thread(self, change)
        return change()

    def _change(self, request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        """Change the state, or raise why that is impossible; with rclpy alone the node would terminate."""
        wanted = f"transition {request.transition.label or request.transition.id}"
        # A client may request the next transition on the event of the last one, before that one has returned.
        if not self._in_transition.acquire(timeout=_BETWEEN_TRANSITIONS_S):
            raise LiveError(f"{wanted}: expected no transition in progress, found one")
        try:
            return self._change_state(request, response)
        except RuntimeError:  # from rclpy
            raise LiveError(f"{wanted}: expected a transition that the present state has") from None
        finally:
            self._in_transition.release()

    def _attempt(self, work: Callable[[], None], scope: ExitStack) -> TransitionCallbackReturn:
        """Do the work of a transition in this thread, and register in ``scope`` how it is undone."""
        self._scope, self._scope_thread = scope, threading.get_ident()
        result = self._try(work, TransitionCallbackReturn.FAILURE)
        self._scope = None
        if result == TransitionCallbackReturn.FAILURE:
            scope.close()
        return result

    def _try(
        self, work: Callable[[], None], failed: TransitionCallbackReturn = TransitionCallbackReturn.ERROR
    ) -> TransitionCallbackReturn:
        """Do some work and log its failure: rclpy would discard an exception without logging it."""
        try:
            work()
        except Exception as error:
            self.get_logger().error(exception_guards.one_line(error))
            return failed
        return TransitionCallbackReturn.SUCCESS
