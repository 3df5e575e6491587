"""Exceptions in callbacks do not end a node."""

import asyncio

import rclpy
from rclpy.lifecycle import TransitionCallbackReturn
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from tactile_localizer.ros.base.managed_node import ManagedNode


def fail(*arguments):
    raise KeyError("a key\nthat is not there")


def test_an_unexpected_exception_is_a_rejection_in_one_line():
    rclpy.init()
    node = ManagedNode("fragile")
    try:
        service = node.create_service(Trigger, "~/break", fail)
        answer = asyncio.run(service.callback(Trigger.Request(), Trigger.Response(success=True)))
        assert not answer.success
        assert answer.message.startswith("unexpected KeyError: 'a key\\nthat is not there' (test_exception")
        node.create_subscription(Empty, "~/broken", fail, 1).callback(Empty())
        node.create_timer(1.0, fail).callback()
        node.configure = fail
        assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
        node.configure, node.activate = lambda: None, fail
        publisher = node.create_lifecycle_publisher(Empty, "~/active", 1)
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
        assert (node.is_active, publisher.is_activated) == (False, False)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
