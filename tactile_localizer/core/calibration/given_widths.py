"""Check of kernel widths that a scene gives against the scan's own held-out strains."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.calibration.kernel_widths import held_out_log_densities
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths
from tactile_localizer.scene import Scene

_TYPICAL_FACTORS = 0.5, 0.7
"""Shares of the spacing of the sweeps and of their disagreement that are usually chosen."""
_STRAIN_LOSS = 1.0
"""Nats per channel by which held-out strains may be less probable: a strain width three times too large, or
half as large as it should be. By judgement."""
_POSITION_LOSS = 2.0
"""Nats by which the most telling tenth of them may be less probable through the position width alone: four
times the spacing of the sweeps on simulated bumps and snaps, of which most feels alike. By judgement."""


def describe_unfit_widths(scan: Scan, scene: Scene) -> str | None:
    """One line where the kernel widths that ``scene`` gives do not fit the scan; ``None`` where they do.

    A sweep that is left out of the map has to be about as probable with them as with widths taken from the
    scan: too narrow kernels do not reach it, too wide ones explain everything.
    """
    parameters = ModelParameters.of_scene(scene)
    if parameters.position_std is None and parameters.strain_std is None:
        return None
    position, strain = base_widths(scan, scene)
    typical = _TYPICAL_FACTORS[0] * position, _TYPICAL_FACTORS[1] * strain
    given = (
        typical[0] if parameters.position_std is None else parameters.position_std,
        typical[1] if parameters.strain_std is None else parameters.strain_std,
    )
    reference = _held_out(scan, scene, *typical)
    loss = float(np.mean(reference - _held_out(scan, scene, *given)))
    by_position = 0.0
    if parameters.position_std is not None:
        by_position = float(np.quantile(reference - _held_out(scan, scene, given[0], typical[1]), 0.9))
    if loss <= _STRAIN_LOSS * scene.layout.size and by_position <= _POSITION_LOSS:
        return None
    names = {"position_std": "m", "strain_std": "V"}
    found = ", ".join(
        f"{name} {_plain(getattr(parameters, name))} {unit}"
        for name, unit in names.items()
        if getattr(parameters, name) is not None
    )
    expected = ", ".join(
        f"{name} {_plain(np.median(width))}" for name, width in zip(names, typical, strict=True)
    )
    return (
        f"measurement of scene {scene.name}: expected kernel widths that fit the scan's held-out strains "
        f"(about {expected}), found {found}: strains are {min(max(loss, by_position), 1e6):.0f} nats "
        "less probable; leave them out to have them chosen"
    )


def _held_out(scan: Scan, scene: Scene, position_std: object, strain_std: object) -> np.ndarray:
    """Log-densities (M,) of held-out strains; finite, so that they can be subtracted."""

    def build(rest: Scan) -> MeasurementModel:
        return SumOfGaussians(rest, scene, position_std, strain_std, precision="float64")

    _, found = held_out_log_densities(scan, scene, np.arange(len(scan)), build)
    return np.nan_to_num(found, nan=-1e9, posinf=1e9, neginf=-1e9)


def _plain(value: object) -> str:
    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    return f"{values[0]:.2g}" if len(values) == 1 else f"[{values.min():.2g} to {values.max():.2g}]"
