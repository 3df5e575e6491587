"""A ROS domain and a CAN port that no other run on this machine uses."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from tactile_localizer.errors import LiveError

_DOMAINS = range(1, 100)
"""Domain ids whose ports lie below the ephemeral ones."""

_CAN_PORTS = 43200
"""UDP port of the simulated CAN bus of domain 0. udp_multicast keeps buses apart by port only."""


@dataclass(frozen=True)
class Domain:
    """What keeps one run apart from all others.

    Parameters
    ----------
    number : the ROS domain id
    can_port : UDP port of the simulated CAN bus
    """

    number: int
    can_port: int

    @property
    def environment(self) -> dict[str, str]:
        """Variables for processes of the run: they are heard on this machine only."""
        return {"ROS_DOMAIN_ID": str(self.number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@contextmanager
def own_domain() -> Iterator[Domain]:
    """A domain that is this run's own until the end of the context.

    Who listens on the TCP namesake of the CAN port has both the domain and the port.

    Raises
    ------
    LiveError
        All are in use.
    """
    for i in _DOMAINS:
        number = _DOMAINS[(os.getpid() + i) % len(_DOMAINS)]
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as claim:
            try:
                claim.bind(("127.0.0.1", _CAN_PORTS + number))
            except OSError:
                continue
            yield Domain(number, _CAN_PORTS + number)
            return
    raise LiveError("ROS_DOMAIN_ID: expected a free one of 1 to 99, found all in use")
