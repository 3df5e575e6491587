"""Opening a python-can bus with kernel filters and receive buffer, and reading the kernel's drop count."""

from __future__ import annotations

import inspect
import logging
import os
import re
import socket
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import can
import yaml
from can.interfaces import BACKENDS

from tactile_localizer.errors import CanError, did_you_mean
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.yaml_file import in_one_line, parse_yaml

# python-can logs the errors that it raises; the exception is enough.
logging.getLogger("can").addHandler(logging.NullHandler())

FILTERING_INTERFACES = ("socketcan", "kvaser", "vector", "etas", "systec")
"""Interfaces of python-can that filter by identifier in the kernel or the adapter, as of version 4.6."""

_SO_RCVBUFFORCE = 33
_SO_MEMINFO = 55
"""Linux socket options without a name in Python's socket module."""

_MEMINFO = struct.Struct("9I")


class AbsentBusError(CanError):
    """A bus that may become available later: its adapter is not connected, or its interface is down."""


@dataclass(frozen=True)
class BusSettings:
    """Bus to open, with its options.

    Parameters
    ----------
    interface : python-can interface, such as ``socketcan`` or ``udp_multicast``
    channel : channel of the interface, such as ``can0`` or ``239.74.163.2``
    options : further arguments of the interface, such as ``bitrate`` or ``port``
    receive_buffer : size of the kernel's receive buffer, bytes; 0: the default
    """

    interface: str
    channel: str
    options: Mapping[str, Any] = field(default_factory=dict)
    receive_buffer: int = 0

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"


@dataclass(frozen=True)
class ReceiveQueue:
    """The kernel's receive queue: bytes used, capacity in bytes, frames dropped since the bus was opened."""

    used: int
    limit: int
    drops: int


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
            raise CanError(
                f"bus option {text!r:.60}: expected a value in YAML, {in_one_line(error)}"
            ) from None
    return options


def open_bus(settings: BusSettings, protocol: LoadCellProtocol | None = None) -> can.BusABC:
    """Open the bus; with a ``protocol``, only for its frames if the kernel or the adapter can filter.

    Elsewhere python-can would filter in this process, which costs more than it saves, so all frames pass.

    Raises
    ------
    AbsentBusError
        The bus cannot be opened now.
    CanError
        There is no such interface, or an option is not one of the interface.
    """
    options = dict(settings.options)
    _check_options(settings)
    if protocol is not None and protocol.is_fd:
        options.setdefault("fd", True)
    try:
        bus = can.Bus(interface=settings.interface, channel=settings.channel, **options)
    except Exception as error:  # interfaces raise many types of exceptions
        reason = " ".join(str(error.__cause__ or error).split()) or type(error).__name__
        absent = isinstance(error, OSError | can.CanInitializationError | can.CanOperationError)
        refusal = AbsentBusError if absent else CanError
        raise refusal(f"CAN bus {settings}: expected an interface that opens, got: {reason}") from error
    try:
        if protocol is not None and settings.interface in FILTERING_INTERFACES:
            bus.set_filters(protocol.filters)
        if settings.receive_buffer:
            _set_receive_buffer(bus, settings.receive_buffer)
    except Exception as error:
        bus.shutdown()
        raise CanError(f"CAN bus {settings}: could not set its options: {error}") from error
    return bus


def _check_options(settings: BusSettings) -> None:
    """Refuse options that python-can would ignore: those that no constructor of the interface mentions."""
    try:
        module, name = BACKENDS[settings.interface]
        classes = getattr(import_module(module), name).__mro__
        sources = [inspect.getsource(one.__init__) for one in classes if issubclass(one, can.BusABC)]
    except (KeyError, AttributeError, ImportError, OSError, TypeError):
        return  # opening it gives the reason
    known = set(re.findall(r"\w+", "".join(sources)))
    for option in set(settings.options) - known:
        raise CanError(
            f"bus option {option!r}: expected an option of the interface {settings.interface}"
            f"{did_you_mean(option, known)}"
        )


def receive_queue(bus: can.BusABC) -> ReceiveQueue | None:
    """The kernel's receive queue of ``bus``; ``None`` if the interface is not a socket."""
    sock = _socket_of(bus)
    if sock is None:
        return None
    with sock:
        try:
            info = _MEMINFO.unpack(sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
        except (OSError, struct.error):
            return None
    return ReceiveQueue(used=info[0], limit=info[1], drops=info[8])


def _set_receive_buffer(bus: can.BusABC, size: int) -> None:
    sock = _socket_of(bus)
    if sock is None:
        return
    with sock:
        try:  # exceeds net.core.rmem_max if the process has CAP_NET_ADMIN
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size)
        except PermissionError:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)


def _socket_of(bus: can.BusABC) -> socket.socket | None:
    # A duplicate handle of the bus's socket, which the caller closes.
    try:
        return socket.socket(fileno=os.dup(bus.fileno()))
    except (NotImplementedError, OSError, ValueError):
        return None
