"""CSV files of one finger on a line."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.io.recording import Recording
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene("line", (Axis("x", 0, 1),), (Phalanx("index", (0,)),))
GAUGES = [f"index_{gauge}" for gauge in range(1, 9)]
HEADER = ["stamp_s", "x", *GAUGES]


def write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[Any]], **options: Any) -> Path:
    """Write a table; returns its path."""
    with path.open("w", newline="") as file:
        csv.writer(file, **options).writerows([header, *rows])
    return path


def line_rows(n: int) -> list[list[Any]]:
    """Rows of ``n`` samples on a line, 10 ms and 1 mm apart."""
    return [
        [f"{1.0 + 0.01 * row:.2f}", 0.001 * row, *(row + gauge / 10 for gauge in range(8))]
        for row in range(n)
    ]


def as_text(
    header: Sequence[str] = HEADER, rows: Sequence[Sequence[Any]] | None = None, separator: str = ","
) -> str:
    """A table as text, by default of ``line_rows(4)``."""
    return "\n".join(separator.join(map(str, row)) for row in [header, *(rows or line_rows(4))]) + "\n"


def assert_four_rows(recording: Recording) -> None:
    """The recording is ``line_rows(4)``, whole."""
    assert recording.notes == ()
    assert recording.lost == 0
    (sweep,) = recording.sweeps
    assert sweep.stamp_ns.tolist() == [1_000_000_000, 1_010_000_000, 1_020_000_000, 1_030_000_000]
    np.testing.assert_allclose(sweep.position[:, 0], [0, 0.001, 0.002, 0.003])
    np.testing.assert_allclose(sweep.strain[:, 1], [0.1, 1.1, 2.1, 3.1])
