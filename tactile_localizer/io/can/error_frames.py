"""Error frames of SocketCAN: errors on the bus, and states of the CAN controller.

Error classes are bits of the identifier, details are bytes of the data (``linux/can/error.h``).
"""

import can

CONTROLLER_STATES = ("error active", "error warning", "error passive", "bus off", "stopped", "sleeping")
"""States of a CAN controller, in the order of the kernel (``linux/can/netlink.h``); the first is good."""

ERROR_ACTIVE, ERROR_WARNING, ERROR_PASSIVE, BUS_OFF = CONTROLLER_STATES[:4]

NO_ACKNOWLEDGEMENT = "no acknowledgement"
OTHER = "other error"

# Bits of the identifier; those from 16 on are bits of data byte 1, which details the class 0x04 (controller).
_ERRORS = {
    0x01: "transmit timeout",
    0x02: "lost arbitration",
    0x08: "protocol violation",
    0x10: "transceiver fault",
    0x20: NO_ACKNOWLEDGEMENT,
    0x80: "bus error",
    0x01_0000: "receive overflow",
    0x02_0000: "transmit overflow",
}
_STATES = {0x40: BUS_OFF, 0x30_0000: ERROR_PASSIVE, 0x0C_0000: ERROR_WARNING, 0x40_0100: ERROR_ACTIVE}


def read_error_frame(message: can.Message) -> tuple[list[str], str]:
    """Errors that an error frame reports, and the new state of the controller (empty: no change)."""
    bits = message.arbitration_id
    if bits & 0x04 and len(message.data) > 1:
        bits |= message.data[1] << 16
    errors = [name for bit, name in _ERRORS.items() if bits & bit]
    state = next((name for bit, name in _STATES.items() if bits & bit), "")
    return errors or ([] if state else [OTHER]), state
