"""Frames of load cells whose samples are distinguishable by their voltages."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import can
import numpy as np

from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.resources import resource_path

PERIOD_NS = 5_000_000
"""Period of the cycles, ns."""

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first cycle, ns."""

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: hand\n\n'
"""Of a DBC whose messages follow."""

CLASSIC = resource_path("config/loadcells.dbc").read_text()


def write_dbc(path: Path, text: str) -> Path:
    """Write a DBC; returns its path."""
    path.write_text(text)
    return path


def write_cells(
    path: Path, cells: Mapping[str, Sequence[str]], counter: str = "", volts: float = 1.0
) -> Path:
    """Write a DBC with messages of gauges, from identifier 0x100 on; returns its path.

    Parameters
    ----------
    cells : gauges of each message, each of 16 bits
    counter : size and range of a counter behind the gauges, such as ``4 [0|14]``; empty: none
    volts : resolution of the gauges, V
    """
    text = HEAD
    for k, (name, gauges) in enumerate(cells.items()):
        text += f"BO_ {256 + k} {name}: {2 * len(gauges) + 4 * bool(counter)} hand\n"
        for n, gauge in enumerate(gauges):
            text += f' SG_ {gauge} : {16 * n}|16@1- ({volts},0) [0|0] "V" hand\n'
        if counter:
            bits, limits = counter.split()
            text += f' SG_ counter : {16 * len(gauges)}|{bits}@1+ (1,0) {limits} "" hand\n'
        text += "\n"
    return write_dbc(path, text)


def protocol(phalanges: Sequence[str] = ("index", "middle"), dbc: str = "loadcells.dbc") -> LoadCellProtocol:
    """One of the example layouts."""
    return LoadCellProtocol(resource_path(f"config/{dbc}"), phalanges)


def strain_of(phalanx: int, number: int) -> np.ndarray:
    """Voltages (8,), V, of a sample: multiples of 0.25 mV that are different for 1000 samples in a row."""
    return np.round((number % 1000 - 500) * 8 + np.arange(8) * 0.5 + phalanx * 4) * 0.00025


def number_of(phalanx: int, strain: np.ndarray) -> int:
    """Number (of 1000) of the sample of ``strain`` (8,); fails if its voltages are of several samples."""
    number = round((strain[0] / 0.00025 - phalanx * 4) / 8) + 500
    np.testing.assert_allclose(strain, strain_of(phalanx, number), atol=1e-9)
    return number


def data_of(protocol: LoadCellProtocol, frames: Sequence[can.Message]) -> bytearray:
    """Data of a cycle with these frames."""
    data = bytearray(protocol.size)
    for frame in frames:
        kind, slot, _ = protocol.classify(frame)
        assert kind == FrameKind.DATA
        data[protocol.bytes_of(slot)] = frame.data
    return data


def strain_in(hand: LoadCellProtocol, frames: Sequence[can.Message]) -> np.ndarray:
    """The strain vector, V, of a cycle with these frames."""
    return hand.decode(data_of(hand, frames))[0]


def sample(
    protocol: LoadCellProtocol, phalanx: int, number: int, stamp_ns: int | None = None
) -> list[can.Message]:
    """Frames of one sample; by default stamped with the nominal time of its cycle."""
    stamp_ns = START_NS + number * PERIOD_NS if stamp_ns is None else stamp_ns
    return protocol.encode(phalanx, strain_of(phalanx, number), number, stamp_s=stamp_ns * 1e-9)


def cycle(protocol: LoadCellProtocol, number: int, stamp_ns: int | None = None) -> list[can.Message]:
    """Frames of one sample of every phalanx."""
    return [frame for p in range(len(protocol.phalanges)) for frame in sample(protocol, p, number, stamp_ns)]
