"""Private interfaces of rclpy that the nodes use; tested with rclpy 7.1 (Jazzy) and 9.1 (Kilted).

If another version of rclpy lacks one of these, misspelt parameters are ignored without a warning, a node
that falls behind its inputs catches up more slowly, and the lifecycle services of a destroyed node stay in
the ROS graph until the process ends.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription


def parameter_overrides(node: Node) -> list[str]:
    """Names of the parameters given on the command line and in files, whether declared or not.

    The public ``automatically_declare_parameters_from_overrides`` fails on an empty list.
    """
    return list(getattr(node, "_parameter_overrides", ()))


def take_message(subscription: Subscription, message_type: Any) -> Any:
    """The next queued message of a subscription; ``None`` if the queue is empty."""
    with subscription.handle:
        take = getattr(subscription.handle, "take_message", None)
        taken = take(message_type, False) if take else None
    return taken[0] if taken is not None else None


def destroy_state_machine(node: Node) -> None:
    """Destroy the state machine of a destroyed node, which holds its lifecycle services and publisher."""
    if (machine := getattr(node, "_state_machine", None)) is not None:
        machine.destroy_when_not_in_use()
