"""The private interface of rclpy that the nodes use; tested with rclpy 7.1 (Jazzy) and 9.1 (Kilted).

If another version of rclpy lacks it, misspelt parameters are ignored without a warning.
"""

from __future__ import annotations

from rclpy.node import Node


def parameter_overrides(node: Node) -> list[str]:
    """Names of the parameters given on the command line and in files, whether declared or not.

    The public ``automatically_declare_parameters_from_overrides`` fails on an empty list.
    """
    return list(getattr(node, "_parameter_overrides", ()))
