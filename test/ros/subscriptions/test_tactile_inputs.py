"""Strain and palm poses that wait while a node is busy."""

from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from support import bags
from support.hand import DEEP_QUEUE

from tactile_localizer.msg import StrainVectors


def test_poses_do_not_fall_behind_the_strain_that_waits_for_them(construct, probe, files):
    """The executor processes one message of each topic in turn, and there are five poses for each strain."""
    node, executor = construct("mapping", {**files, **DEEP_QUEUE}), SingleThreadedExecutor()
    node.trigger_configure()
    node.trigger_activate()
    sent = {"strain": [bags.strain(ms) for ms in range(20, 1001, 20)]}
    sent["palm_pose"] = [bags.pose(ms) for ms in range(4, 1021, 4)]
    for topic, kind in (("strain", StrainVectors), ("palm_pose", PoseStamped)):
        publisher = probe.publisher(kind, topic, 1000)
        for message in sent[topic]:
            publisher.publish(bytes(bags.STORE.serialize_cdr(message, bags.TYPES[topic])))
        assert publisher.wait_for_all_acked(Duration(seconds=30))
    executor.add_node(node)
    received = node._inputs.received
    while received["strain"] < 50:
        executor.spin_once()
        assert received["palm_pose"] >= 5 * (received["strain"] - 1)
    executor.shutdown()
