"""What rclpy keeps to itself and the nodes cannot do without; tried with rclpy 7.1 (Jazzy) and 9.1 (Kilted).

Where another rclpy lacks one of these, mistyped parameters pass without a word, a node behind its inputs
catches up more slowly, and a destroyed node's lifecycle services stay in the graph until the process ends.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription


def given_parameters(node: Node) -> list[str]:
    """Names of the parameters given on the command line and in files, whether declared or not.

    ``automatically_declare_parameters_from_overrides`` would tell as much, but fails on an empty list.
    """
    return list(getattr(node, "_parameter_overrides", ()))


def take_message(subscription: Subscription, kind: Any) -> Any:
    """The next message that waits, as rclpy's executor takes it; ``None`` where there is none."""
    with subscription.handle:
        take = getattr(subscription.handle, "take_message", None)
        taken = take(kind, False) if take else None
    return taken[0] if taken is not None else None


def withdraw_lifecycle_services(node: Node) -> None:
    """Let go of a destroyed node's state machine, which holds its services and its publisher."""
    if (machine := getattr(node, "_state_machine", None)) is not None:
        machine.destroy_when_not_in_use()
