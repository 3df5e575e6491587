"""Corruptions of strain vectors and palm poses; each function modifies a message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.conversions.timestamps import from_ns, to_ns


def stuck() -> Callable[[StrainVectors], None]:
    """The strain of the first phalanx is stuck at its first value."""
    first: list[float] = []

    def spoil(message: StrainVectors) -> None:
        if not first:
            first.extend(message.strain[: _first(message)])
        message.strain[: _first(message)] = _array(message, first)

    return spoil


def swapped(message: StrainVectors) -> None:
    """The gauges of the first phalanx are wired in reverse order."""
    message.strain[: _first(message)] = _array(message, message.strain[: _first(message)][::-1])


def scaled(message: StrainVectors) -> None:
    """The amplifier of the first phalanx has a different gain."""
    message.strain[: _first(message)] = _array(
        message, [2.5 * volts for volts in message.strain[: _first(message)]]
    )


def not_finite(message: StrainVectors) -> None:
    """A strain value is NaN although the status is OK."""
    message.strain[3] = np.nan


def _first(message: StrainVectors) -> int:
    """Number of channels of the first phalanx."""
    return ChannelLayout.of(message.channels, len(message.phalanges)).counts[0]


def _array(message: StrainVectors, values: Sequence[float]) -> Any:
    return type(message.strain)("d", values)


def unordered(message: PoseStamped) -> None:
    """Every other pose, by stamps, is half a second late."""
    if message.header.stamp.nanosec // 20_000_000 % 2:
        total_ns = to_ns(message.header.stamp) - 500_000_000
        message.header.stamp = from_ns(total_ns)


def nowhere(message: PoseStamped) -> None:
    """The position of the palm is NaN."""
    message.pose.position.x = np.nan


def foreign_frame(message: PoseStamped) -> None:
    """The pose is in an unknown frame."""
    message.header.frame_id = "elsewhere"


def foreign_phalanges(message: StrainVectors) -> None:
    """The strain is of phalanges that are not in the map."""
    message.phalanges = ["thumb", "little"]
