"""Subscriptions that drain their queues, so that a node that fell behind its inputs catches up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice, zip_longest
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from tactile_localizer.ros.base.rclpy_private import take_message

MAX_BACKLOG = 0.5
"""Fraction of the depth of a queue above which its messages are skipped: 50 of 100, 50 ms at 1 kHz."""


class Topic(NamedTuple):
    """A topic to subscribe to.

    Parameters
    ----------
    message_type, name, callback : as for ``create_subscription``
    qos : can be overridden by parameters
    on_skip : called with the number of skipped messages when the node is late: only the newest of a longer
        backlog is handled; ``None``: all are handled
    """

    message_type: Any
    name: str
    callback: Callable[[Any], None]
    qos: QoSProfile
    on_skip: Callable[[int], None] | None = None


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
        queues = [_take_queued(*pair) for pair in zip(subscriptions, topics, strict=True)]
        for messages in zip_longest(*queues):
            for topic, message in zip(topics, messages, strict=True):
                if message is not None:
                    topic.callback(message)

    def draining(callback: Callable[[Any], None]) -> Callable[[Any], None]:
        def handle(message: Any) -> None:
            callback(message)
            drain()

        return handle

    for topic in topics:
        options = QoSOverridingOptions.with_default_policies()
        subscriptions.append(
            node.create_subscription(
                topic.message_type,
                topic.name,
                draining(topic.callback),
                topic.qos,
                qos_overriding_options=options,
            )
        )


def _take_queued(subscription: Subscription, topic: Topic) -> list[Any]:
    """The queued messages; of a long backlog that may be skipped only the newest."""
    depth = subscription.qos_profile.depth
    take = partial(take_message, subscription, topic.message_type)
    messages = list(islice(iter(take, None), depth))
    if topic.on_skip is not None and len(messages) > MAX_BACKLOG * depth:
        topic.on_skip(len(messages) - 1)
        messages = messages[-1:]
    return messages
