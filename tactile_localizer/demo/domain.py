"""Reservation of a ROS domain and a CAN port for one run on this machine."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from tactile_localizer.errors import LiveError

_DOMAINS = range(1, 100)
"""Domain ids whose UDP ports are below the ephemeral ports."""

_FIRST_CAN_PORT = 43200
"""UDP port of the simulated CAN bus of domain 0; udp_multicast separates buses by port only."""


@dataclass(frozen=True)
class Domain:
    """ROS domain and CAN port of one run.

    Parameters
    ----------
    number : ROS domain id
    can_port : UDP port of the simulated CAN bus
    """

    number: int
    can_port: int

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables for the processes of the run; discovery is limited to this machine."""
        return {"ROS_DOMAIN_ID": str(self.number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@contextmanager
def own_domain() -> Iterator[Domain]:
    """Context that reserves a domain and its CAN port.

    A process owns both while it is bound to the TCP port with the number of the CAN port.

    Raises
    ------
    LiveError
        All domains are in use.
    """
    for i in _DOMAINS:
        number = _DOMAINS[(os.getpid() + i) % len(_DOMAINS)]
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as claim:
            try:
                claim.bind(("127.0.0.1", _FIRST_CAN_PORT + number))
            except OSError:
                continue
            yield Domain(number, _FIRST_CAN_PORT + number)
            return
    raise LiveError("ROS_DOMAIN_ID: expected a free domain from 1 to 99, all are in use")
