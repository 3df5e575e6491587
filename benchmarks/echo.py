"""Node that only returns each strain message, to measure the latency of rclpy and DDS on this machine."""

import contextlib

import rclpy
from nodes import BEST_EFFORT
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from tactile_localizer.msg import StrainVectors


def main() -> None:
    """Return messages until interrupted."""
    rclpy.init()
    node = rclpy.create_node("echo")
    publisher = node.create_publisher(StrainVectors, "echo", QoSProfile(depth=1000))
    node.create_subscription(StrainVectors, "strain", publisher.publish, BEST_EFFORT, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt):
        executor.spin()


if __name__ == "__main__":
    main()
