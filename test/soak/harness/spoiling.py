"""What can be wrong with a strain vector or a palm pose; each function changes a message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.msg import StrainVectors
from tactile_localizer.nodes.stamps import from_ns, to_ns


def stuck() -> Callable[[StrainVectors], None]:
    """The first phalanx feels what it felt first, for ever."""
    first: list[float] = []

    def spoil(message: StrainVectors) -> None:
        if not first:
            first.extend(message.strain[: _first(message)])
        message.strain[: _first(message)] = _array(message, first)

    return spoil


def swapped(message: StrainVectors) -> None:
    """The first phalanx's gauges are wired in reverse order."""
    message.strain[: _first(message)] = _array(message, message.strain[: _first(message)][::-1])


def scaled(message: StrainVectors) -> None:
    """The first phalanx's amplifier has another gain."""
    message.strain[: _first(message)] = _array(
        message, [2.5 * volts for volts in message.strain[: _first(message)]]
    )


def not_finite(message: StrainVectors) -> None:
    """A strain is NaN, and the status says that all is well."""
    message.strain[3] = np.nan


def _first(message: StrainVectors) -> int:
    """Channels of the first phalanx."""
    return ChannelLayout.of(message.channels, len(message.phalanges)).counts[0]


def _array(message: StrainVectors, values: Sequence[float]) -> Any:
    return type(message.strain)("d", values)


def unordered(message: PoseStamped) -> None:
    """Every other pose, by stamps, was under way for half a second."""
    if message.header.stamp.nanosec // 20_000_000 % 2:
        total_ns = to_ns(message.header.stamp) - 500_000_000
        message.header.stamp = from_ns(total_ns)


def nowhere(message: PoseStamped) -> None:
    """The arm does not know where it is."""
    message.pose.position.x = np.nan


def foreign_frame(message: PoseStamped) -> None:
    """The pose is in a frame that nobody has told of."""
    message.header.frame_id = "elsewhere"


def foreign_phalanges(message: StrainVectors) -> None:
    """The strain is of fingers that the map does not know."""
    message.phalanges = ["thumb", "little"]
