"""A node that fell behind drains its queues, one message of each topic in turn."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def test_queued_messages_are_drained_in_turn(probe):
    from rclpy.qos import QoSProfile
    from std_msgs.msg import Int32

    from tactile_localizer.ros.subscriptions.draining import MAX_ROUNDS, Topic, subscribe

    sent, deep = MAX_ROUNDS + 10, QoSProfile(depth=1000)
    received = []
    subscribe(
        probe.node,
        [Topic(Int32, name, lambda m, name=name: received.append((name, m.data)), deep) for name in "ab"],
    )
    publishers = [probe.publisher(Int32, name, deep) for name in "ab"]
    for number in range(sent):
        for publisher in publishers:
            publisher.publish(Int32(data=number))
    for publisher in publishers:
        assert publisher.wait_for_all_acked()  # all are queued in the subscriptions
    probe.until(lambda: received, "the first")
    assert 2 * MAX_ROUNDS < len(received) <= 2 * MAX_ROUNDS + 2
    probe.until(lambda: len(received) == 2 * sent, "the rest")
    for name in "ab":
        assert [number for topic, number in received if topic == name] == list(range(sent))
    ahead = np.cumsum([1 if name == "a" else -1 for name, _ in received])
    assert np.abs(ahead).max() <= 2


def test_without_direct_access_messages_are_left_to_the_executor():
    from tactile_localizer.ros.base.rclpy_private import take_message

    other_rclpy = SimpleNamespace(handle=nullcontext())
    assert take_message(other_rclpy, None) is None
