"""A node that is behind takes what waits at once, of each topic in turn and in its order."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def test_what_waits_behind_a_message_is_taken_along_but_timers_get_their_turn(probe):
    from rclpy.qos import QoSProfile
    from std_msgs.msg import Int32

    from tactile_localizer.ros.subscriptions.draining import MAX_ROUNDS, Topic, subscribe

    sent, kept = MAX_ROUNDS + 10, QoSProfile(depth=1000)
    heard = []
    subscribe(
        probe.node,
        [Topic(Int32, name, lambda m, name=name: heard.append((name, m.data)), kept) for name in "ab"],
    )
    publishers = [probe.publisher(Int32, name, kept) for name in "ab"]
    for number in range(sent):
        for publisher in publishers:
            publisher.publish(Int32(data=number))
    for publisher in publishers:
        assert publisher.wait_for_all_acked()  # all wait in the subscriptions
    probe.until(lambda: heard, "the first")
    assert 2 * MAX_ROUNDS < len(heard) <= 2 * MAX_ROUNDS + 2
    probe.until(lambda: len(heard) == 2 * sent, "the rest")
    for name in "ab":
        assert [number for told, number in heard if told == name] == list(range(sent))
    ahead = np.cumsum([1 if name == "a" else -1 for name, _ in heard])
    assert np.abs(ahead).max() <= 2


def test_without_direct_access_messages_are_left_to_the_executor():
    from tactile_localizer.ros.base.rclpy_private import take_message

    other_rclpy = SimpleNamespace(handle=nullcontext())
    assert take_message(other_rclpy, None) is None
