"""A node that records the topics of other nodes and calls their services."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from tactile_localizer.errors import LiveError

Sink = Callable[[str, int, bytes], None]
"""Called with a topic, the time of receipt (ns) and a serialised message."""


class Watcher:
    """Node that spins in a separate thread for the duration of the context.

    Parameters
    ----------
    domain : ROS domain id
    sink : called in the spinning thread with every message of every subscribed topic; ``None``: no recording

    Attributes
    ----------
    received : number of messages received, by topic
    """

    def __init__(self, domain: int, sink: Sink | None = None) -> None:
        self.received: dict[str, int] = {}
        self._sink = sink
        self._failure: Exception | None = None
        self._clients: dict[str, Any] = {}
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self._node = Node("watcher", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="watcher", daemon=True)

    def __enter__(self) -> Watcher:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)
        self._thread.join()

    def check(self) -> None:
        """Raise the exception that ended the spinning thread, if any."""
        if self._failure is not None:
            raise self._failure

    def listen(
        self, kind: Any, topic: str, quality: QoSProfile | int, work: Callable[[Any], None] | None = None
    ) -> None:
        """Subscribe to a topic and record it; ``work`` is called in the spinning thread with each message."""
        name = self._node.resolve_topic_name(topic)
        self.received[topic] = 0

        def take(raw: bytes) -> None:
            self.received[topic] += 1
            if self._sink is not None:
                self._sink(name, time.time_ns(), raw)
            if work is not None:
                work(deserialize_message(raw, kind))

        self._node.create_subscription(kind, topic, take, quality, raw=True)

    def publisher(self, kind: Any, topic: str, quality: QoSProfile | int) -> Any:
        """Create a publisher."""
        return self._node.create_publisher(kind, topic, quality)

    def call(self, kind: Any, service: str, request: Any = None, timeout_s: float = 20.0) -> Any:
        """Call a service and return its response.

        Raises
        ------
        LiveError
            The service is not available, or does not respond in time.
        """
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        client = self._clients[service]
        if not client.wait_for_service(timeout_s):
            raise LiveError(f"service {service}: expected it within {timeout_s:g} s, found none")
        answered = threading.Event()
        future = client.call_async(request if request is not None else kind.Request())
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(timeout_s):
            raise LiveError(f"service {service}: expected an answer within {timeout_s:g} s, got none")
        return future.result()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass
        except Exception as error:  # raised by check()
            self._failure = error
