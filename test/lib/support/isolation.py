"""A ROS domain and a CAN port of this test process's own."""

from __future__ import annotations

import os
import socket

_DOMAINS = range(1, 100)
"""Domain ids whose ports lie below the ephemeral ones."""

_CAN_PORTS = 43200
"""UDP port of domain 0's simulated CAN bus."""


def own_domain() -> tuple[int, socket.socket]:
    """A domain id that no other test process on this machine has while the returned socket is open.

    The socket listens on the CAN port's TCP namesake: who holds it has both the domain and the port.
    """
    first = os.getpid()
    for i in _DOMAINS:
        domain = _DOMAINS[(first + i) % len(_DOMAINS)]
        claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            claim.bind(("127.0.0.1", _CAN_PORTS + domain))
        except OSError:
            claim.close()
        else:
            return domain, claim
    raise RuntimeError("ROS_DOMAIN_ID: expected a free one of 1 to 99, found all in use")


def can_port(domain: int) -> int:
    """UDP port of the simulated CAN bus that belongs to ``domain``.

    udp_multicast keeps buses apart by port only: Linux hands a socket the datagrams of every group that any
    process on the machine has joined.
    """
    return _CAN_PORTS + domain
