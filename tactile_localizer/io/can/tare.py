"""Zeroing the load cells when asked to: an average over a stated time, kept in a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.status import OK
from tactile_localizer.io.whole_file import whole_file
from tactile_localizer.io.yaml_file import load_yaml

LEAST_SAMPLES = 10
"""Samples of each phalanx that a tare needs at least."""


class TareAverage:
    """Averages strain vectors while the stream goes on.

    Parameters
    ----------
    phalanges : names, in the order of the strain vector
    spread_limit : V, the largest standard deviation of a gauge in a hand at rest
    layout : the strain vector's channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self, phalanges: Sequence[str], spread_limit: float, layout: ChannelLayout | None = None
    ) -> None:
        self._phalanges = phalanges
        self._layout = layout or ChannelLayout.of((), len(phalanges))
        self._spread_limit = spread_limit
        self._vectors: list[np.ndarray] = []

    def add(self, strain: np.ndarray, status: np.ndarray) -> None:
        """Take in a strain vector (C,), V, as the load cells sent it, and the (F,) status of the phalanges.

        Of a phalanx that is missing, saturated or faulty nothing is taken.
        """
        well = self._layout.expand(np.asarray(status) == OK)
        self._vectors.append(np.where(well & np.isfinite(strain), strain, np.nan))

    def offset(self) -> np.ndarray:
        """The average (C,), V.

        Raises
        ------
        MeasurementError
            A phalanx sent too few samples that are good, or moved.
        """
        vectors = np.array(self._vectors).reshape(-1, self._layout.size)
        samples = self._layout.min(np.isfinite(vectors).sum(axis=0))
        for name, count in zip(self._phalanges, samples, strict=True):
            if count < LEAST_SAMPLES:
                raise MeasurementError(
                    f"tare: expected at least {LEAST_SAMPLES} samples of {name}, got {count} that are good"
                )
        spread = np.nanstd(vectors, axis=0)
        worst = int(np.argmax(spread))
        if spread[worst] > self._spread_limit:
            phalanx, channel = self._layout.place(worst)
            raise MeasurementError(
                f"tare: expected a hand at rest, with a spread of at most {self._spread_limit:g} V, got "
                f"{spread[worst]:.3g} V on gauge {channel} of {self._phalanges[phalanx]}"
            )
        return np.asarray(np.nanmean(vectors, axis=0))


def load_tare(path: Path, phalanges: Sequence[str], layout: ChannelLayout | None = None) -> np.ndarray:
    """Offsets (C,), V, stored in ``path``; zeros for a phalanx without one, or where there is no file.

    ``layout``: the channels by phalanx; ``None``: the default channels each.

    Raises
    ------
    ParameterError
        The file cannot be read, is not one that :func:`store_tare` writes, or is of other channels.
    """
    stored = _read(path)
    layout = layout or ChannelLayout.of((), len(phalanges))
    offset = np.zeros(layout.size)
    for name, own, channels in zip(phalanges, layout.slices, layout.counts, strict=True):
        values = stored.get(name, [0.0] * channels)
        if len(values) != channels:
            raise ParameterError(
                f"tare file {path}: expected {channels} voltages for phalanx {name}, found {len(values)}"
            )
        offset[own] = values
    return offset


def store_tare(
    path: Path, phalanges: Sequence[str], offset: np.ndarray, layout: ChannelLayout | None = None
) -> None:
    """Store ``offset`` (C,), V, in ``path``, leaving what it holds of other phalanges. Zeros are no entry.

    ``layout`` as for :func:`load_tare`.

    Raises
    ------
    ParameterError
        The file cannot be read or written.
    """
    stored = _read(path)
    layout = layout or ChannelLayout.of((), len(phalanges))
    for name, values in zip(phalanges, layout.split(offset), strict=True):
        stored.pop(name, None)
        if values.any():
            stored[name] = [float(value) for value in values]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished:
            text = yaml.safe_dump(stored, default_flow_style=None)
            unfinished.write_text(f"# Tare offsets, V, one per channel\n{text}", encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"tare file {path}: expected to write it, {error.strerror}") from error


def _read(path: Path) -> dict[str, list[float]]:
    try:
        stored = load_yaml(path, "a tare file", ParameterError) or {}
    except FileNotFoundError:
        return {}
    if not isinstance(stored, dict) or not all(_is_offset(values) for values in stored.values()):
        raise ParameterError(f"tare file {path}: expected voltages for each phalanx, found something else")
    return stored


def _is_offset(values: object) -> bool:
    return isinstance(values, list) and all(
        isinstance(value, int | float) and math.isfinite(value) for value in values
    )
