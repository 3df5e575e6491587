"""A ROS node that observes the nodes under test from outside."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger
from support.waiting import PATIENCE_S, Deadline

T = TypeVar("T")

_ASK_AGAIN_S = 2.0


class Probe:
    """A node in a separate context that spins only while the test waits.

    Messages of :meth:`listen` gather in lists; :meth:`until` spins until a condition is true.
    """

    best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def __init__(self, name: str = "probe", namespace: str = "") -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node(name, namespace=namespace or None, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], T], what: object, timeout_s: float = PATIENCE_S) -> T:
        """Spin until ``condition`` is true and return its value; fails the test if that takes too long."""
        deadline = Deadline(what, timeout_s)
        while not (value := condition()):
            deadline.check()
            self.executor.spin_once(timeout_sec=0.05)
        return value

    def listen(self, kind: Any, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
        """The messages of a topic, in a list that grows while the probe spins."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def diagnostics(self) -> list[Any]:
        """The messages on ``/diagnostics``, as of :meth:`listen`; see :mod:`support.diagnostics`."""
        return self.listen(DiagnosticArray, "/diagnostics", 100)

    def publisher(self, kind: Any, topic: str, qos: QoSProfile | int = 10) -> Any:
        """A publisher, once it is matched with a subscriber."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.until(lambda: publisher.get_subscription_count() > 0, f"a subscriber of {topic}")
        return publisher

    def call(self, kind: Any, service: str, request: Any = None, timeout_s: float = PATIENCE_S) -> Any:
        """The response of a service, once it is available and the node knows its client."""
        client = self.node.create_client(kind, service)
        try:
            self.until(client.service_is_ready, f"service {service}", timeout_s)
            self.known_to(service.rpartition("/")[0])
            future = client.call_async(request if request is not None else kind.Request())
            self.until(future.done, f"an answer of {service}", timeout_s)
            return future.result()
        finally:
            self.node.destroy_client(client)

    def trigger(self, service: str) -> Any:
        """The response of a service without arguments."""
        return self.call(Trigger, service)

    def change(self, node: str, transition: str) -> bool:
        """Request a transition of a lifecycle node, such as ``configure``; returns whether it succeeded."""
        number = getattr(Transition, f"TRANSITION_{transition.upper()}")
        request = ChangeState.Request(transition=Transition(id=number))
        return bool(self.call(ChangeState, f"{node}/change_state", request, timeout_s=120.0).success)

    def set_parameter(self, node: str, name: str, value: Any) -> Any:
        """The result of setting a parameter."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, f"{node}/set_parameters", request).results[0]

    def known_to(self, node: str) -> None:
        """Wait until ``node`` knows every publisher and subscription that the probe has made so far.

        A matched publisher says only that the probe knows the subscription; until the node knows the
        publisher too, best-effort messages are lost. Endpoints are announced in the order in which they were
        made, so the answer to a client made now proves that the node knows all before it. An answer that is
        sent before the client is known is lost, so it is asked for again.
        """
        service = f"{node}/get_parameters"
        client = self.node.create_client(GetParameters, service)
        self.until(client.service_is_ready, f"service {service}")
        asked: list[Any] = []

        def answered() -> bool:
            if time.monotonic() > begun + _ASK_AGAIN_S * len(asked):
                asked.append(client.call_async(GetParameters.Request(names=["use_sim_time"])))
            return any(future.done() for future in asked)

        begun = time.monotonic()
        try:
            self.until(answered, f"an answer of {service}")
        finally:
            self.node.destroy_client(client)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)
