"""Subscriptions that drain their queues, so that a node that fell behind its inputs catches up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from tactile_localizer.ros.base.rclpy_private import take_message

MAX_ROUNDS = 20
"""Largest number of messages of each topic handled before the executor serves timers and services again."""


class Topic(NamedTuple):
    """A topic to subscribe to; ``qos`` can be overridden by parameters."""

    message_type: Any
    name: str
    callback: Callable[[Any], None]
    qos: QoSProfile


def subscribe(node: Node, topics: Sequence[Topic]) -> None:
    """Subscribe to topics; each callback is followed by those for the messages that wait on all topics.

    Between two messages the executor of rclpy inspects every entity of the node, which takes longer than
    handling most messages. Queued messages are therefore taken directly, one of each topic in turn as the
    executor would: a topic that ran ahead of the others would not find its counterparts.

    Parameters
    ----------
    node : node that subscribes
    topics : topics that belong together
    """
    subscriptions: list[Subscription] = []

    def drain() -> None:
        for _ in range(MAX_ROUNDS):
            handled = [_handle_next(*pair) for pair in zip(subscriptions, topics, strict=True)]
            if not any(handled):
                return

    def draining(callback: Callable[[Any], None]) -> Callable[[Any], None]:
        def handle(message: Any) -> None:
            callback(message)
            drain()

        return handle

    for message_type, name, callback, qos in topics:
        options = QoSOverridingOptions.with_default_policies()
        subscriptions.append(
            node.create_subscription(
                message_type, name, draining(callback), qos, qos_overriding_options=options
            )
        )


def _handle_next(subscription: Subscription, topic: Topic) -> bool:
    """Handle the next queued message; returns whether there was one."""
    message = take_message(subscription, topic.message_type)
    if message is not None:
        topic.callback(message)
    return message is not None
