"""Private interfaces of rclpy that the nodes use; tested with rclpy 7.1 (Jazzy) and 9.1 (Kilted).

If another version of rclpy lacks one of these, misspelt parameters are ignored without a warning, and the
lifecycle services of a destroyed node stay in the ROS graph until the process ends.
"""

from __future__ import annotations

from rclpy.node import Node


def parameter_overrides(node: Node) -> list[str]:
    """Names of the parameters given on the command line and in files, whether declared or not.

    The public ``automatically_declare_parameters_from_overrides`` fails on an empty list.
    """
    return list(getattr(node, "_parameter_overrides", ()))


def destroy_state_machine(node: Node) -> None:
    """Destroy the state machine of a destroyed node, which holds its lifecycle services and publisher."""
    if (machine := getattr(node, "_state_machine", None)) is not None:
        machine.destroy_when_not_in_use()
