"""Arrays of a scan are checked for consistency."""

import numpy as np
import pytest

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError

GOOD = {
    "states": np.zeros((3, 2)),
    "strain": np.zeros((3, 16)),
    "sweep": np.array([5, 5, 2]),
    "axes": ("x", "y"),
    "phalanges": ("index", "middle"),
}


def test_a_scan_has_a_length_and_sweep_numbers():
    scan = Scan(**GOOD)
    assert len(scan) == 3
    assert scan.sweep_numbers.tolist() == [2, 5]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"states": np.zeros((0, 2))}, "scan: expected at least one state-measurement pair, found none"),
        ({"states": np.zeros((3, 3))}, r"scan states: expected shape \(3, 2\), got \(3, 3\)"),
        ({"strain": np.zeros((3, 8))}, r"scan strain: expected shape \(3, 16\), got \(3, 8\)"),
        ({"sweep": np.zeros(2)}, r"scan sweep: expected shape \(3,\), got \(2,\)"),
        ({"states": np.full((3, 2), np.nan)}, "scan states: expected finite values, found NaN or infinity"),
        ({"strain": np.full((3, 16), np.inf)}, "scan strain: expected finite values, found NaN or infinity"),
    ],
)
def test_inconsistent_arrays_are_refused(wrong, message):
    with pytest.raises(ScanError, match=message):
        Scan(**(GOOD | wrong))
