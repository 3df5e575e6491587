"""Simulated load cells on a CAN bus: sends strain voltages as frames, with optional faults."""

from collections.abc import Collection
from dataclasses import dataclass

import can
import numpy as np

from tactile_localizer.errors import CanError, refusing
from tactile_localizer.io.can.protocol import LoadCellProtocol


@dataclass(frozen=True)
class Faults:
    """Faults on the bus; none by default.

    Parameters
    ----------
    drop : probability that a frame is lost
    garbage : probability per frame that an invalid frame follows: an unknown identifier, a wrong length, a
        remote frame or an error frame
    silent : phalanges whose load cell sends nothing
    """

    drop: float = 0.0
    garbage: float = 0.0
    silent: Collection[str] = ()


NO_FAULTS = Faults()


class CanLoadCells:
    """Load cells on one bus.

    Parameters
    ----------
    protocol : frame layout of the load cells
    bus : bus to send on; the caller closes it
    rng : random generator of the faults
    """

    def __init__(self, protocol: LoadCellProtocol, bus: can.BusABC, rng: np.random.Generator) -> None:
        self._protocol = protocol
        self._bus = bus
        self._rng = rng
        self._sequence = 0

    def send(self, strain: np.ndarray, faults: Faults = NO_FAULTS) -> None:
        """Send one sample of every load cell.

        Parameters
        ----------
        strain : (C,) V, in the order of the protocol's phalanges

        Raises
        ------
        CanError
            The bus does not accept the frames.
        """
        frames: list[can.Message] = []
        for phalanx, name in enumerate(self._protocol.phalanges):
            if name in faults.silent:
                continue
            voltages = strain[self._protocol.channels.slices[phalanx]]
            for frame in self._protocol.encode(phalanx, voltages, self._sequence):
                if self._rng.random() >= faults.drop:
                    frames.append(frame)
                if self._rng.random() < faults.garbage:
                    frames.append(self._garbage(frame))
        self._sequence += 1
        with refusing(f"{self._bus.channel_info}: could not send a frame", CanError, can.CanError, OSError):
            for frame in frames:  # one after the other, so that they are close together on the bus
                self._bus.send(frame)

    def _garbage(self, frame: can.Message) -> can.Message:
        """A random invalid frame."""
        data = self._rng.bytes(8)
        foreign = int(self._rng.integers(0x700, 0x7FF))
        known, extended = frame.arbitration_id, frame.is_extended_id
        return (
            can.Message(arbitration_id=foreign, is_extended_id=False, data=data),
            can.Message(arbitration_id=known, is_extended_id=extended, data=data[:3]),
            can.Message(arbitration_id=known, is_extended_id=extended, is_remote_frame=True),
            can.Message(is_error_frame=True),
        )[self._rng.integers(4)]
