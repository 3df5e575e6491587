"""Error frames of SocketCAN, in which a CAN controller reports errors on the bus.

Error classes are bits of the identifier, details are bytes of the data (``linux/can/error.h``).
"""

from __future__ import annotations

import can

BUS_OFF = "bus off"
ERROR_PASSIVE = "error passive"
NO_ACKNOWLEDGEMENT = "no acknowledgement"
OTHER = "other error"

_CONTROLLER_CLASS = 0x04
_CLASSES = {
    0x01: "transmit timeout",
    0x02: "lost arbitration",
    0x08: "protocol violation",
    0x10: "transceiver fault",
    0x20: NO_ACKNOWLEDGEMENT,
    0x40: BUS_OFF,
    0x80: "bus error",
    0x100: "controller restarted",
}
_CONTROLLER_STATES = {  # bits of data byte 1
    0x01: "receive overflow",
    0x02: "transmit overflow",
    0x04: "error warning",
    0x08: "error warning",
    0x10: ERROR_PASSIVE,
    0x20: ERROR_PASSIVE,
    0x40: "error active",
}

ERROR_KINDS = tuple(dict.fromkeys([*_CLASSES.values(), *_CONTROLLER_STATES.values(), OTHER]))
"""All kinds of errors that :func:`error_kinds` distinguishes."""


def error_kinds(message: can.Message) -> list[str]:
    """Kinds of errors reported by an error frame, without duplicates."""
    kinds = {name: None for bit, name in _CLASSES.items() if message.arbitration_id & bit}
    if message.arbitration_id & _CONTROLLER_CLASS:
        state = message.data[1] if len(message.data) > 1 else 0
        kinds |= {name: None for bit, name in _CONTROLLER_STATES.items() if state & bit}
    return list(kinds) or [OTHER]
