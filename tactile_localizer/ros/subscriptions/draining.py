"""Subscriptions that a node behind its inputs catches up with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from tactile_localizer.ros.base.rclpy_private import take_message

MOST_AT_ONCE = 20
"""Most messages of each topic for which one goes on without a look at timers and services."""


class Topic(NamedTuple):
    """What is heard: kind and name, who takes a message, and the quality unless parameters say otherwise."""

    kind: Any
    name: str
    work: Callable[[Any], None]
    quality: QoSProfile


def hear(node: Node, topics: Sequence[Topic]) -> list[Subscription]:
    """Subscribe to topics of which nothing may wait longer than it must.

    An executor of rclpy goes through all that a node has before it hands over one message of each topic,
    which takes longer than most messages do. So what waits behind a message is taken along: one of each topic
    in turn, as the executor would, for a topic that runs ahead of the others would not find its like.

    Parameters
    ----------
    node : whose subscriptions they are, to be destroyed by the caller
    topics : what is heard
    """
    subscriptions: list[Subscription] = []

    def take_waiting() -> None:
        for _ in range(MOST_AT_ONCE):
            taken = [_take(heard, topic) for heard, topic in zip(subscriptions, topics, strict=True)]
            if not any(taken):
                return

    def taking(work: Callable[[Any], None]) -> Callable[[Any], None]:
        def take(message: Any) -> None:
            work(message)
            take_waiting()

        return take

    for kind, name, work, quality in topics:
        options = QoSOverridingOptions.with_default_policies()
        subscriptions.append(
            node.create_subscription(kind, name, taking(work), quality, qos_overriding_options=options)
        )
    return subscriptions


def _take(subscription: Subscription, topic: Topic) -> bool:
    """Whether a message waited; it is handed over."""
    message = take_message(subscription, topic.kind)
    if message is not None:
        topic.work(message)
    return message is not None
