"""Opening of a python-can bus, and what the kernel knows about it: its interface and its receive queue."""

import errno
import logging
import os
import socket
import struct
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import can
import yaml
from can.interfaces.socketcan import SocketcanBus

from tactile_localizer.errors import CanError, in_one_line
from tactile_localizer.io.can.commands import Commands
from tactile_localizer.io.can.error_frames import CONTROLLER_STATES
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.yaml_file import parse_yaml, yaml_reason

# python-can logs the errors that it raises; the exception is enough.
logging.getLogger("can").addHandler(logging.NullHandler())

HOST_CLOCK_INTERFACES = ("socketcan", "udp_multicast")
"""Interfaces of python-can whose stamps are the receive times of this machine's kernel."""

_FD_MTU = 72
"""MTU of an interface with CAN FD, bytes; 16 without."""

# Numbers of linux/if.h, linux/if_link.h and linux/can/netlink.h
_IFF_UP = 1
_IFLA_MTU, _IFLA_LINKINFO, _IFLA_STATS64, _IFLA_INFO_DATA, _IFLA_CAN_STATE = 4, 18, 23, 2, 4


class AbsentBusError(CanError):
    """A bus that may become available later, such as one whose adapter is not connected."""


@dataclass(frozen=True)
class BusSettings:
    """Bus to open, with its options.

    Parameters
    ----------
    interface : python-can interface, such as ``socketcan`` or ``udp_multicast``
    channel : channel of the interface, such as ``can0`` or ``239.74.163.2``
    options : further arguments of the interface, such as ``bitrate`` or ``port``
    receive_buffer : size of the kernel's receive buffer, bytes; 0: the default
    commands : frames to send
    """

    interface: str
    channel: str
    options: Mapping[str, Any] = field(default_factory=dict)
    receive_buffer: int = 0
    commands: Commands = field(default_factory=Commands)

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"


@dataclass(frozen=True)
class ReceiveQueue:
    """The kernel's receive queue: capacity in bytes, and frames dropped since the bus was opened."""

    limit: int
    drops: int


@dataclass(frozen=True)
class Link:
    """A CAN interface of the kernel.

    Attributes
    ----------
    is_up : whether it is set up
    mtu : size of its longest frame, bytes
    received : frames received by the interface, whatever their identifiers
    controller : state of its controller (:mod:`~tactile_localizer.io.can.error_frames`); empty if it has none
    """

    is_up: bool
    mtu: int
    received: int
    controller: str


def parse_options(texts: list[str]) -> dict[str, Any]:
    """Parse options of the form ``name=value``, with values in YAML: ``port=43113`` is a number.

    Raises
    ------
    CanError
        An option has a different form.
    """
    options = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.isidentifier()):
            raise CanError(f"bus option {text!r}: expected name=value")
        try:
            options[name] = parse_yaml(value)
        except yaml.YAMLError as error:
            reason = yaml_reason(error)
            raise CanError(f"bus option {text!r:.60}: expected a value in YAML, {reason}") from None
    return options


def open_bus(settings: BusSettings, protocol: LoadCellProtocol | None = None) -> can.BusABC:
    """Open the bus, with CAN FD if it is an interface of the kernel that has it.

    With a ``protocol`` the kernel filters its frames. Of other interfaces all frames pass, so that foreign
    ones can be reported. Configuration files of python-can are not read.

    Raises
    ------
    AbsentBusError
        The bus cannot be opened now.
    CanError
        There is no such interface, an option has a wrong type, or the interface lacks CAN FD.
    """
    options = dict(settings.options)
    if protocol is not None and protocol.is_fd:
        options.setdefault("fd", True)
    bus = None
    try:
        if settings.interface == "socketcan":
            with suppress(OSError):  # without the interface the bus fails
                options.setdefault("fd", _link(settings.channel).mtu >= _FD_MTU)
        if "state" in options:
            options["state"] = can.BusState[options["state"]]
        bus = can.Bus(settings.channel, settings.interface, ignore_config=True, **options)
        if protocol is not None and isinstance(bus, SocketcanBus):
            bus.set_filters(protocol.filters)
        if settings.receive_buffer:
            _set_receive_buffer(bus, settings.receive_buffer)
        link = link_of(bus)
    except Exception as error:  # interfaces raise many types of exceptions
        if bus is not None:
            bus.shutdown()
        reason = in_one_line(error.__cause__ or error)
        absent = isinstance(error, OSError | can.CanInitializationError | can.CanOperationError)
        refusal = AbsentBusError if absent else CanError
        raise refusal(f"CAN bus {settings}: expected an interface that opens, got: {reason}") from error
    if options.get("fd") and link is not None and link.mtu < _FD_MTU:
        bus.shutdown()
        raise CanError(f"CAN bus {settings}: expected an MTU of {_FD_MTU} for CAN FD, found {link.mtu}")
    return bus


def link_of(bus: can.BusABC) -> Link | None:
    """The interface of a bus, from the kernel by netlink; ``None`` if it is not one of SocketCAN.

    Raises
    ------
    OSError
        The interface is gone.
    """
    return _link(bus.channel) if isinstance(bus, SocketcanBus) else None


def _link(channel: str) -> Link:
    index = socket.if_nametoindex(channel)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW) as kernel:
        # struct nlmsghdr and struct ifinfomsg: RTM_GETLINK (18) of this index, as a request (1)
        kernel.send(struct.pack("=IHHII BxHiII", 32, 18, 1, 0, 0, 0, 0, index, 0, 0))
        answer = kernel.recv(1 << 16)
    flags, found = struct.unpack_from("=I", answer, 24)[0], _attributes(answer[32:])
    if not {_IFLA_MTU, _IFLA_STATS64, _IFLA_LINKINFO} <= found.keys():
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
    own = _attributes(_attributes(found[_IFLA_LINKINFO]).get(_IFLA_INFO_DATA, b""))
    return Link(
        is_up=bool(flags & _IFF_UP),
        mtu=int.from_bytes(found[_IFLA_MTU], sys.byteorder),
        received=int.from_bytes(found[_IFLA_STATS64][:8], sys.byteorder),
        controller=CONTROLLER_STATES[own[_IFLA_CAN_STATE][0]] if _IFLA_CAN_STATE in own else "",
    )


def _attributes(data: bytes) -> dict[int, bytes]:
    """Netlink attributes by type."""
    found = {}
    while len(data) >= 4:
        length, kind = struct.unpack_from("=HH", data)
        found[kind & 0x3FFF] = data[4:length]
        data = data[max(4, length + 3 & ~3) :]
    return found


def receive_queue(bus: can.BusABC) -> ReceiveQueue | None:
    """The kernel's receive queue of ``bus`` (SO_MEMINFO); ``None`` if the interface is not a socket."""
    meminfo = struct.Struct("9I")
    with suppress(NotImplementedError, OSError, ValueError), _socket_of(bus) as sock:
        info = meminfo.unpack(sock.getsockopt(socket.SOL_SOCKET, 55, meminfo.size))
        return ReceiveQueue(limit=info[1], drops=info[8])
    return None


def _set_receive_buffer(bus: can.BusABC, size: int) -> None:
    with suppress(NotImplementedError, OSError, ValueError), _socket_of(bus) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size // 2)  # of which the kernel takes twice
        # SO_RCVBUFFORCE exceeds net.core.rmem_max if the process has CAP_NET_ADMIN
        sock.setsockopt(socket.SOL_SOCKET, 33, size // 2)


def _socket_of(bus: can.BusABC) -> socket.socket:
    # A duplicate handle of the bus's socket, which the caller closes.
    return socket.socket(fileno=os.dup(bus.fileno()))
