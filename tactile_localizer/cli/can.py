"""``tactile-localizer can``: decode and check the load cells on a CAN bus or in a CAN log."""

from __future__ import annotations

import argparse
import itertools
import reprlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
from rich.console import Console

from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import CanError, ParameterError
from tactile_localizer.io.can.bus import BusSettings, open_bus, parse_options
from tactile_localizer.io.can.check import CanCheck, identifier
from tactile_localizer.io.can.driver import DriverSettings
from tactile_localizer.io.can.frames import frame_key
from tactile_localizer.io.can.layout import SignalNames, load_dbc, phalanges_of
from tactile_localizer.io.can.log import BATCH, read_log
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.yaml_file import load_yaml
from tactile_localizer.offline.table import Table
from tactile_localizer.resources import given_or_shipped

DEFAULTS: dict[str, Any] = {
    "dbc": "loadcells.dbc",
    "gauge_signals": list(SignalNames.gauges),
    "counter_signal": SignalNames.counter,
    "status_signal": SignalNames.status,
    "interface": "socketcan",
    "channel": "can0",
    "bus_options": [],
    "cycle_timeout_s": DriverSettings.cycle_timeout_s,
    "phalanges": [],
}
"""Defaults of the driver node's parameters of the same names; by default all phalanges of the DBC."""

_TIMEOUT_S = 0.0005, 1.0
"""Range of ``cycle_timeout_s``, as in the driver node."""

_MESSAGE_COLUMNS = ("message", "identifier", "frames", "rate, Hz", "bytes")
_PHALANX_COLUMNS = ("phalanx", "samples", "rate, Hz", "frames lost", "saturated", "faults", "volts")
_WAIT_S = 0.1
_PIPE_WIDTH = 120
_RECEIVE_BUFFER = 1 << 22


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        "action",
        choices=("dump", "check"),
        help="print each frame decoded, or summarize the traffic and list problems",
    )
    parser.add_argument("--log", type=Path, help="read this log (candump, ASC, BLF, ...) instead of a bus")
    parser.add_argument("--config", type=Path, help="driver parameters (YAML); other options override them")
    parser.add_argument("--interface", help="python-can interface (default socketcan)")
    parser.add_argument(
        "--channel", help="channel of the interface (default can0), or of the log (default: its only one)"
    )
    parser.add_argument(
        "--option", dest="bus_options", action="append", metavar="NAME=VALUE", help="option of the interface"
    )
    parser.add_argument("--dbc", help="CAN database: a path, or a shipped one (default loadcells.dbc)")
    parser.add_argument(
        "--phalanges",
        nargs="+",
        metavar="NAME",
        help="load cells (default: those in the DBC that send frames)",
    )
    parser.add_argument(
        "--seconds", type=float, help="duration, s (default: 5 for check; dump and logs: to the end)"
    )


def run(args: argparse.Namespace) -> int:
    """Read the bus or the log; returns 1 if ``check`` finds a problem."""
    if args.seconds is not None and not args.seconds > 0:
        raise ParameterError(f"--seconds: expected more than 0, got {args.seconds:g}")
    parameters = DEFAULTS
    if args.config is not None:
        parameters = parameters | load_yaml(
            args.config, "driver parameters", ParameterError, _driver_parameters
        )
    parameters = parameters | {
        name: value for name, value in vars(args).items() if name in DEFAULTS and value is not None
    }
    protocol = _protocol(parameters)
    width = None if sys.stdout.isatty() else _PIPE_WIDTH
    console = Console(highlight=False, soft_wrap=True, markup=False, emoji=False, width=width)
    if args.action == "dump":
        return _dump(console, protocol, _batches(args, parameters, protocol, args.seconds))
    check = CanCheck(protocol, parameters["cycle_timeout_s"], all_required=bool(parameters["phalanges"]))
    seconds = 5.0 if args.seconds is None and args.log is None else args.seconds
    for messages in _batches(args, parameters, protocol, seconds):
        check.feed(messages)
    check.finish()
    return _report(console, check)


def _driver_parameters(content: Any) -> dict[str, Any]:
    try:
        (node,) = content.values()
        parameters = dict(node["ros__parameters"])
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ParameterError("expected ros__parameters of one node, found none") from None
    for name, value in parameters.items():
        if expected := _wrong_type(name, value):
            raise ParameterError(f"{name}: expected {expected}, got {reprlib.repr(value)}")
    return parameters


def _wrong_type(name: str, value: Any) -> str:
    """Expected type of a parameter whose value is of another; empty if it fits or is not used here."""
    default = [] if name.startswith("messages.") else DEFAULTS.get(name)
    if isinstance(default, list):
        fits = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
        return "" if fits else "a list of strings"
    if isinstance(default, float):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        least, most = _TIMEOUT_S
        return "" if is_number and least <= value <= most else f"a number from {least:g} to {most:g}"
    return "" if default is None or isinstance(value, str) else "a string"


def _protocol(parameters: dict[str, Any]) -> LoadCellProtocol:
    path = given_or_shipped(parameters["dbc"], "config")
    names = SignalNames(
        tuple(parameters["gauge_signals"]), parameters["counter_signal"], parameters["status_signal"]
    )
    phalanges = parameters["phalanges"] or phalanges_of(load_dbc(path), names)
    if not phalanges:
        raise CanError(f"{path}: expected messages with the signal {names.gauges[0]!r}, found none")
    messages = {name: parameters.get(f"messages.{name}", ()) for name in phalanges}
    return LoadCellProtocol.from_dbc(path, phalanges, messages, names)


def _batches(
    args: argparse.Namespace, parameters: dict[str, Any], protocol: LoadCellProtocol, seconds: float | None
) -> Iterator[list[can.Message]]:
    """Frames of the log or the bus for ``seconds``; ``None``: the whole log, or the bus until interrupted."""
    if args.log is not None:
        yield from read_log(args.log, args.channel, seconds)
        return
    settings = BusSettings(
        parameters["interface"],
        parameters["channel"],
        parse_options(parameters["bus_options"]) | ({"fd": True} if protocol.is_fd else {}),
        _RECEIVE_BUFFER,
    )
    end_s = None if seconds is None else time.monotonic() + seconds
    with open_bus(settings) as bus:  # no filters: unknown identifiers are reported too
        while end_s is None or time.monotonic() < end_s:
            try:
                yield _received(bus)
            except (can.CanError, OSError) as error:
                raise CanError(f"CAN bus {settings}: expected frames, got: {error}") from error


def _received(bus: can.BusABC) -> list[can.Message]:
    messages: list[can.Message] = []
    message = bus.recv(_WAIT_S)
    while message is not None:
        messages.append(message)
        message = bus.recv(0) if len(messages) < BATCH else None
    return messages


def _dump(console: Console, protocol: LoadCellProtocol, batches: Iterator[list[can.Message]]) -> int:
    names = protocol.message_names
    for message in itertools.chain.from_iterable(batches):
        decoded = protocol.decode(message)
        head = f"{message.timestamp:.6f}  {identifier(frame_key(message)):>8}"
        if decoded.kind != FrameKind.DATA:
            kind = decoded.kind.name.lower().replace("_", " ")
            console.print(f"{head}  {kind}  {message.data.hex(' ')}", style="yellow")
            continue
        volts = " ".join(f"{value:+9.5f}" for value in decoded.voltage)
        marks = " saturated" * decoded.saturated + " fault" * decoded.fault
        console.print(f"{head}  {names[decoded.slot]:16} {decoded.counter:5}  {volts} V{marks}")
    return 0


def _report(console: Console, check: CanCheck) -> int:
    console.print(f"{check.frames} frames in {check.duration_s:.2f} s")
    messages = [
        (
            message.name,
            message.identifier,
            str(message.frames),
            f"{message.rate_hz:.1f}",
            ", ".join(map(str, message.found_bytes)) or "-",
        )
        for message in check.messages()
    ]
    phalanges = [
        (
            phalanx.name,
            *map(str, (phalanx.counts.samples, f"{phalanx.rate_hz:.1f}", phalanx.counts.drops)),
            *map(str, (phalanx.counts.saturated, phalanx.counts.faults)),
            f"{phalanx.lowest.min():+.4f} to {phalanx.highest.max():+.4f}" if phalanx.counts.samples else "-",
        )
        for phalanx in check.phalanges()
    ]
    if messages:
        print_tables([Table("", _MESSAGE_COLUMNS, messages), Table("", _PHALANX_COLUMNS, phalanges)])
    for name, frames, rate_hz in check.unknown()[:10]:
        console.print(f"not in the DBC: {name}, {frames} frames, {rate_hz:.1f} Hz")
    if check.absent():
        console.print(f"absent: {', '.join(check.absent())}")
    problems = check.problems()
    for problem in problems:
        console.print(f"problem: {problem}", style="red")
    if not problems:
        console.print("no problems found", style="green")
    return 1 if problems else 0
