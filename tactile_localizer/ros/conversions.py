"""Values of ROS messages: time stamps, and the content of strain vectors."""

from array import array

import numpy as np
from builtin_interfaces.msg import Time

from tactile_localizer.msg import StrainVectors
from tactile_localizer.streams.runs import NANOSECONDS


def from_ns(stamp_ns: int) -> Time:
    """Time stamp of a number of nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def fill(
    message: StrainVectors, stamp_ns: int, strain: np.ndarray, status: np.ndarray, sequence: np.ndarray
) -> None:
    """Fill in strain (C,), V, status bits (F,) uint8 and sequence numbers (F,) uint32 at a stamp, ns."""
    message.header.stamp = from_ns(stamp_ns)
    # Arrays of these types are adopted as they are, lists are checked element by element.
    message.strain = array("d", strain.tobytes())
    message.status = array("B", status.tobytes())
    message.sequence = array("I", sequence.tobytes())
