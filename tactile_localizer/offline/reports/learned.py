"""Tables of the values learned from a scan: noise, lengths, registration, parameters of kernel models."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.table import Table
from tactile_localizer.scene import Scene

FEATURELESS, TEXTURED = "featureless between features", "textured everywhere"
"""Kinds of material."""


def noise_table(scene: Scene, model: SweepModel, unit: str = "V") -> Table:
    """Noise between sweeps and signal of each phalanx.

    Parameters
    ----------
    scene : scene of the scan
    model : model learned from the scan
    unit : unit of the strain
    """
    noise = model.noise.model
    coloured = np.linalg.inv(noise.whitening)
    visit = np.sqrt(model.variance.visit) * np.linalg.norm(coloured, axis=1)
    offset = np.sqrt((coloured**2) @ noise.offset_variance)
    strain = np.concatenate([track.strain for track in model.noise.recorded])
    signal = strain.std(axis=0)
    rows = [
        (
            phalanx.name,
            str(phalanx.channels),
            _median(visit[channels]),
            f"{visit[channels].max():.3g}",
            _median(offset[channels]),
            _median(signal[channels]),
        )
        for phalanx, channels in zip(scene.phalanges, scene.layout.slices, strict=True)
    ]
    columns = (
        "phalanx",
        "channels",
        f"noise, {unit}",
        f"noisiest, {unit}",
        f"offset, {unit}",
        f"strain, {unit}",
    )
    note = (
        "Standard deviations. Noise: of a sweep about the prediction of the others, median and noisiest "
        "channel; offset: of the constant between sweeps; strain: over the scan, median channel."
    )
    return Table("Noise", columns, rows, note)


def learned_table(scene: Scene, mixture: SweepMixture, calibration: Calibration) -> Table:
    """Kind of the material, information and presence length, and registration."""
    rows = [(name, value) for name, value in learned_values(scene, mixture, calibration).items()]
    note = (
        "Information length: travel per independent measurement of the position; presence length: the same "
        "for whether the palm is on the map; registration: standard deviation of the displacement between "
        "sweeps."
    )
    return Table("Learned from the scan", ("", "value"), rows, note)


def learned_values(scene: Scene, mixture: SweepMixture, calibration: Calibration) -> dict[str, str]:
    """Values learned from a scan by name, with units."""
    registration = ", ".join(
        _with_unit(axis, std)
        for axis, std in zip(scene.axis_names, calibration.registration_std, strict=True)
    )
    return {
        "material": TEXTURED if mixture.map.featureless_variance is None else FEATURELESS,
        "information length": f"{calibration.information_length * MM:.1f} mm",
        "registration": registration,
    }


def widths_table(scene: Scene, parameters: ModelParameters, unit: str = "V") -> Table:
    """Widths of the kernel models."""
    positions = np.broadcast_to(np.asarray(parameters.position_std, dtype=np.float64), scene.dimension)
    strains = np.broadcast_to(np.asarray(parameters.strain_std, dtype=np.float64), scene.layout.size)
    rows = [
        (f"position, {axis}", _with_unit(axis, std))
        for axis, std in zip(scene.axis_names, positions, strict=True)
    ]
    rows += [
        (f"strain, {phalanx.name}", f"{_median(strains[channels])} {unit}")
        for phalanx, channels in zip(scene.phalanges, scene.layout.slices, strict=True)
    ]
    note = "Standard deviations, of the median channel."
    return Table("Kernel widths", ("", "width"), rows, note)


def _median(values: np.ndarray) -> str:
    return f"{np.median(values):.3g}"


def _with_unit(axis: str, std: float) -> str:
    return f"{axis} {np.degrees(std):.2f}°" if axis == "yaw" else f"{axis} {std * MM:.2f} mm"
