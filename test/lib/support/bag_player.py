"""Plays a bag as ``ros2 bag play`` does, where there is none: it waits for no subscriber.

    ros2 bag play BAG --clock HZ --rate R [--delay S] [--loop] [--topics TOPIC ...]

``test/lib/bin/ros2`` runs this; it knows no other command.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import sys
import time
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from tactile_localizer.io.bags.reader import typestore


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="ros2")
    parser.add_argument("bag", choices=["bag"])
    parser.add_argument("play", choices=["play"])
    parser.add_argument("path", type=Path)
    parser.add_argument("--clock", type=float, required=True)
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--delay", type=float, default=0.0)
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--topics", nargs="+", default=[])
    play(parser.parse_args(arguments))
    return 0


def play(args: argparse.Namespace) -> None:
    import rclpy
    from rclpy.executors import ExternalShutdownException

    with AnyReader([args.path], default_typestore=typestore()) as reader:
        chosen = [c for c in reader.connections if c.topic in args.topics or not args.topics]
        kinds = {connection.topic: connection.msgtype for connection in chosen}
        received = [
            (connection.topic, stamp_ns, bytes(raw))
            for connection, stamp_ns, raw in (reader.messages(chosen) if chosen else ())
        ]
    rclpy.init(args=[])
    try:
        player = _Player(kinds, args.clock, args.rate)
        while True:
            time.sleep(args.delay)
            player.play(received)
            if not args.loop:
                break
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        with contextlib.suppress(RuntimeError):  # a signal shuts down at the same moment
            rclpy.try_shutdown()


class _Player:
    def __init__(self, kinds: dict[str, str], clock_hz: float, rate: float) -> None:
        import rclpy
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rosgraph_msgs.msg import Clock

        self._node, self._Clock = rclpy.create_node("rosbag2_player"), Clock
        self._period_ns, self._rate = 1e9 / clock_hz, rate
        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._clock = self._node.create_publisher(Clock, "/clock", best_effort)
        self._topics = {
            topic: self._node.create_publisher(
                _message_class(kind), topic, best_effort if topic.endswith("strain") else 100
            )
            for topic, kind in kinds.items()
        }

    def play(self, received: list[tuple[str, int, bytes]]) -> None:
        if not received:
            return
        start_ns, begun_s = received[0][1], time.monotonic()
        shown_ns = 0.0
        for topic, stamp_ns, raw in received:
            while (now_ns := start_ns + 1e9 * self._rate * (time.monotonic() - begun_s)) < stamp_ns:
                time.sleep(0.001)
            if abs(now_ns - shown_ns) >= self._period_ns:
                shown_ns = now_ns
                message = self._Clock()
                message.clock.sec, message.clock.nanosec = divmod(int(now_ns), 1_000_000_000)
                self._clock.publish(message)
            self._topics[topic].publish(raw)


def _message_class(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
