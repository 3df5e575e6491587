"""A node that fell behind drains its queues, one message of each topic in turn."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

pytestmark = pytest.mark.ros


@pytest.fixture
def queued(probe):
    """``queued(**skip)`` subscribes to two topics, fills their queues, and returns what is received."""
    from rclpy.qos import QoSProfile
    from std_msgs.msg import Int32

    from tactile_localizer.ros.subscriptions.draining import Topic, subscribe

    def fill(depth, sent, on_skip=None):
        received = []
        subscribe(
            probe.node,
            [
                Topic(
                    Int32,
                    name,
                    lambda m, name=name: received.append((name, m.data)),
                    QoSProfile(depth=depth),
                    on_skip if name == "a" else None,
                )
                for name in "ab"
            ],
        )
        publishers = [probe.publisher(Int32, name, QoSProfile(depth=depth)) for name in "ab"]
        for number in range(sent):
            for publisher in publishers:
                publisher.publish(Int32(data=number))
        for publisher in publishers:
            assert publisher.wait_for_all_acked()  # all are queued in the subscriptions
        probe.until(lambda: ("b", sent - 1) in received, "the last message")
        return received

    return fill


def test_queued_messages_are_drained_in_turn(queued):
    received = queued(depth=100, sent=40)
    for name in "ab":
        assert [number for topic, number in received if topic == name] == list(range(40))
    ahead = np.cumsum([1 if name == "a" else -1 for name, _ in received])
    assert np.abs(ahead).max() <= 2


def test_a_late_node_skips_to_the_newest_message(queued):
    skipped = []
    received = queued(depth=50, sent=40, on_skip=skipped.append)
    handled = [number for topic, number in received if topic == "a"]
    assert handled[-1] == 39
    assert len(handled) <= 2
    assert len(handled) + sum(skipped) == 40
    assert [number for topic, number in received if topic == "b"] == list(range(40))


def test_without_direct_access_messages_are_left_to_the_executor():
    from tactile_localizer.ros.base.rclpy_private import take_message

    other_rclpy = SimpleNamespace(handle=nullcontext())
    assert take_message(other_rclpy, None) is None
