"""Publishers of the nodes add nothing to what the executor waits for."""

import pytest

pytestmark = pytest.mark.ros


def test_no_publisher_of_a_node_waits_for_events():
    import rclpy
    from std_msgs.msg import Empty

    from tactile_localizer.ros.base.managed_node import ManagedNode

    rclpy.init()
    node = ManagedNode("quiet")
    try:
        node.create_publisher(Empty, "~/plain", 1)
        node.create_lifecycle_publisher(Empty, "~/lifecycle", 1)
        assert not list(node.waitables)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
