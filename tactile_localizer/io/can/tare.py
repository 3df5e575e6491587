"""Tare of the load cells: the average strain over a given time, stored in a file."""

import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.status import OK
from tactile_localizer.io.whole_file import write_text
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.quantity import number

MIN_SAMPLES = 10
"""Fewest valid samples per phalanx for a tare; the average has a third of the noise of a sample."""


def tare_offset(
    cycles: Sequence[Cycle], phalanges: Sequence[str], layout: ChannelLayout, spread_limit: float
) -> np.ndarray:
    """Average strain (C,), V, of a hand at rest.

    Parameters
    ----------
    cycles : as the load cells sent them; phalanges whose status is not OK are ignored
    phalanges : names, in the order of the strain vector
    layout : channels of the strain vector by phalanx
    spread_limit : largest standard deviation of a gauge in a hand at rest, V

    Raises
    ------
    MeasurementError
        A phalanx has too few valid samples, or moved.
    """
    strain = np.array([cycle.strain for cycle in cycles]).reshape(-1, layout.size)
    status = np.array([cycle.status for cycle in cycles]).reshape(-1, len(phalanges))
    valid = layout.expand(status == OK) & np.isfinite(strain)
    for name, counts in zip(phalanges, layout.split(valid.sum(axis=0)), strict=True):
        if counts.min() < MIN_SAMPLES:
            raise MeasurementError(
                f"tare: expected at least {MIN_SAMPLES} valid samples of {name}, got {counts.min()}"
            )
    spread = np.std(strain, axis=0, where=valid)
    worst = int(np.argmax(spread))
    if spread[worst] > spread_limit:
        phalanx, channel = layout.place(worst)
        raise MeasurementError(
            f"tare: expected a hand at rest, with a spread of at most {spread_limit:g} V, got "
            f"{spread[worst]:.3g} V on gauge {channel} of {phalanges[phalanx]}"
        )
    return np.asarray(np.mean(strain, axis=0, where=valid))


def load_tare(path: Path, phalanges: Sequence[str], layout: ChannelLayout) -> np.ndarray:
    """Read offsets (C,), V, from a file; zeros for phalanges without an entry, or without a file.

    ``layout``: the channels by phalanx.

    Raises
    ------
    ParameterError
        The file cannot be read, was not written by :func:`store_tare`, or has other channels.
    """
    stored = _read(path)
    offset = np.zeros(layout.size)
    for name, part, count in zip(phalanges, layout.slices, layout.counts, strict=True):
        values = stored.get(name, [0.0] * count)
        if len(values) != count:
            raise ParameterError(
                f"tare file {path}: expected {count} voltages for phalanx {name}, found {len(values)}"
            )
        offset[part] = values
    return offset


def store_tare(path: Path, phalanges: Sequence[str], offset: np.ndarray, layout: ChannelLayout) -> None:
    """Write ``offset`` (C,), V, to a file, keeping the entries of other phalanges; zeros have no entry.

    ``layout`` as for :func:`load_tare`.

    Raises
    ------
    ParameterError
        The file cannot be read or written.
    """
    stored = _read(path)
    for name, values in zip(phalanges, layout.split(offset), strict=True):
        stored.pop(name, None)
        if values.any():
            stored[name] = [float(value) for value in values]
    text = yaml.safe_dump(stored, default_flow_style=None)
    write_text(path, f"# Tare offsets, V, one per channel\n{text}", ParameterError)


def _read(path: Path) -> dict[str, list[float]]:
    return load_yaml(path, "a tare file", ParameterError, _offsets) if path.exists() else {}


def _offsets(content: Any) -> dict[str, list[float]]:
    stored = dict(mapping(content or {}, "tare"))
    for name, values in stored.items():
        if not isinstance(values, list):
            raise ParameterError(f"{name}: expected a list of voltages, got {reprlib.repr(values)}")
        stored[name] = [number(value, str(name)) for value in values]
    return stored
