"""Metrics of a replay: error, coverage of the 95 % region, convergence, computing time."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.io.recording import Recording
from tactile_localizer.offline.replay import ReplayedSweep

MARKS = (0.0, 0.0025, 0.005, 0.01)
"""Travel after which the error is reported, m."""

_LEAST_FELT = 0.25
"""Regression coefficient of a sweep's strain on the predicted one from which the feature is felt, by
judgement: 0.42 to 1.9 in contact, at most 0.1 in magnitude on blank sheets of three simulators."""

_ROUNDING = 1e-9
"""Rounding error of a sum of many steps, m."""

_CHI_SQUARED_95 = {1: 3.841458820694124, 2: 5.991464547107979, 3: 7.814727903251179}
"""95 % quantiles of the chi-squared distribution by degrees of freedom: importing scipy.special for a number
takes longer than the replay of a sweep."""

_MIN_VARIANCE = 1e-18
"""Lower bound of the variance, m² (yaw: rad²): the covariance of identical particles is zero."""


def deviation(sweep: ReplayedSweep) -> np.ndarray:
    """Estimate minus truth (n, d), along the shortest arc on axes that wrap; NaN where unknown."""
    if sweep.truth is None:
        return np.full(sweep.mean.shape, np.nan)
    return MotionModel(sweep.scene).displacement(sweep.truth, sweep.mean)


def position_error(sweep: ReplayedSweep) -> np.ndarray:
    """Distance between estimate and truth without the yaw, (n,) m; NaN where unknown."""
    lengths = [name != "yaw" for name in sweep.scene.axis_names]
    distance = np.linalg.norm(deviation(sweep)[:, lengths], axis=1)
    return distance if any(lengths) else np.full(len(sweep), np.nan)


def yaw_error(sweep: ReplayedSweep) -> np.ndarray:
    """Absolute error of the yaw of a scene that has one, (n,) rad; NaN where unknown."""
    return np.abs(deviation(sweep)[:, sweep.scene.axis_names.index("yaw")])


def covered(sweep: ReplayedSweep) -> np.ndarray:
    """Whether the 95 % region of each estimate holds the truth, (n,) 1 or 0; NaN where that is unknown."""
    values, vectors = np.linalg.eigh(sweep.covariance)
    along = np.einsum("ndk,nd->nk", vectors, deviation(sweep))
    squared = np.sum(along**2 / np.maximum(values, _MIN_VARIANCE), axis=1)
    return np.where(np.isfinite(squared), squared <= _CHI_SQUARED_95[sweep.scene.dimension], np.nan)


def statistics(values: np.ndarray) -> dict[str, Any]:
    """Count, median, mean, 95th percentile and maximum of the finite values; ``None`` if there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {"count": 0, "median": None, "mean": None, "p95": None, "max": None}
    return {
        "count": len(values),
        "median": float(np.median(values)),
        "mean": float(np.mean(values)),
        "p95": float(np.quantile(values, 0.95)),
        "max": float(np.max(values)),
    }


def travel_from_contact(sweep: ReplayedSweep) -> np.ndarray:
    """Travel from contact, (n,) m, negative before it; from the start of a sweep without contact."""
    start = np.searchsorted(sweep.row[:-1], sweep.contact[0])
    return sweep.travel - sweep.travel[start : start + 1].sum()


def with_contact(recording: Recording, model: SweepMixture) -> Recording:
    """Mark the samples in contact with a feature, in sweeps whose true positions are known.

    A recorded mark is kept; the simulator writes one. Otherwise a sample is in contact if the map predicts
    more than the noise of one sweep for a phalanx at the true position, and the sweep's strain there is at
    least a quarter of what it predicts: a sweep over blank material has no contact. Material that is
    cloth rather than a sheet has none either.

    Parameters
    ----------
    recording : recording with the axes and phalanges of the model
    model : measurement model of the localizer
    """
    return with_contact_on(recording, contact_map(model))


class ContactMap(NamedTuple):
    """What a map predicts at its nodes, without what only a filter needs.

    Parameters
    ----------
    lattice : the map, without its tables
    noise : noise model
    signal : (M, W) whitened strain, mean over the components
    on_feature : (M,) bool
    """

    lattice: StrainMap
    noise: NoiseModel
    signal: np.ndarray
    on_feature: np.ndarray


def contact_map(model: SweepMixture) -> ContactMap | None:
    """Where the map of a model has a feature; ``None`` on cloth, which has none."""
    if model.material is Material.CLOTH:
        return None
    signal = np.einsum("mk,mkc->mc", np.exp(model.map.log_prior), model.map.mean)
    on_feature = np.max(model.noise.layout.mean(signal**2), axis=1) > 1.0
    none = np.zeros(0)
    lattice = model.map._replace(mean=none, variance=none, log_prior=none)
    return ContactMap(lattice, model.noise, signal, on_feature)


def with_contact_on(recording: Recording, contact: ContactMap | None) -> Recording:
    """As :func:`with_contact`, on a map that was made before."""
    if contact is None:
        return recording
    lattice, noise, signal, on_feature = contact
    sweeps = []
    for sweep in recording.sweeps:
        if sweep.felt is None and sweep.truth is not None and np.isfinite(sweep.truth).all():
            node = lattice.nearest(sweep.truth)
            felt = on_feature[node]
            complete = np.isfinite(sweep.strain).all(axis=1)
            on, off = felt & complete, ~felt & complete
            if on.any() and off.any():
                strain, predicted = noise.whitened(sweep.strain), signal[node[on]]
                strain = strain[on] - np.median(strain[off], axis=0)
                felt &= np.sum(strain * predicted) > _LEAST_FELT * np.sum(predicted**2)
            sweep = replace(sweep, felt=felt)
        sweeps.append(sweep)
    return replace(recording, sweeps=tuple(sweeps))


def summarize(sweeps: Sequence[ReplayedSweep]) -> dict[str, Any]:
    """Summary of the sweeps by name, in SI units; ``None`` where unknown.

    If any sweep reaches contact (:attr:`.ReplayedSweep.reaches_contact`), travel counts from contact, and
    ``error_contact_m`` is from contact to the end of the feature; other sweeps do not count there.
    """
    errors = [position_error(sweep) for sweep in sweeps]
    contacts = sum(sweep.reaches_contact for sweep in sweeps)
    after: dict[str, list[float]] = {f"{mark:g}": [] for mark in MARKS}
    for error, sweep in zip(errors, sweeps, strict=True):
        travel = travel_from_contact(sweep)
        for mark in MARKS:
            index = int(np.searchsorted(travel, mark - _ROUNDING))
            if index < len(sweep) and (sweep.reaches_contact or not contacts):
                after[f"{mark:g}"].append(error[index])
    arrived = np.array([_travel_to_convergence(sweep) for sweep in sweeps])
    inside = _pooled([covered(sweep) for sweep in sweeps])
    summary = {
        "sweeps": len(sweeps),
        "strains": sum(map(len, sweeps)),
        "measurement_updates": int(sum(sweep.updated.sum() for sweep in sweeps)),
        "refused": sum(sweep.refused for sweep in sweeps),
        "error_m": statistics(_pooled(errors)),
        "contacts": contacts,
        "error_contact_m": statistics(
            _pooled(errors, [sweep.on_contact & sweep.reaches_contact for sweep in sweeps])
        ),
        "error_converged_m": statistics(_pooled(errors, [sweep.converged for sweep in sweeps])),
        "error_after_travel_m": {mark: statistics(np.array(found)) for mark, found in after.items()},
        "final_error_m": statistics(np.array([error[-1] for error in errors if len(error)])),
        "coverage_95": float(inside.mean()) if len(inside) else None,
        "converged_sweeps": int(np.isfinite(arrived).sum()),
        "travel_to_convergence_m": statistics(arrived),
    }
    if sweeps and "yaw" in sweeps[0].scene.axis_names:
        summary["error_rad"] = statistics(_pooled([yaw_error(sweep) for sweep in sweeps]))
    return summary


def timing(sweeps: Sequence[ReplayedSweep]) -> dict[str, Any]:
    """Computing time per measurement update, per sample and per millimetre of travel, µs."""
    updates = _pooled([sweep.seconds for sweep in sweeps], [sweep.updated for sweep in sweeps]) * 1e6
    every = _pooled([sweep.seconds for sweep in sweeps]) * 1e6
    travel_mm = 1e3 * sum(float(sweep.travel[-1]) for sweep in sweeps if len(sweep))
    if not len(updates):
        return dict.fromkeys(("update_median_us", "update_p99_us", "strain_mean_us", "us_per_mm"))
    return {
        "update_median_us": float(np.median(updates)),
        "update_p99_us": float(np.quantile(updates, 0.99)),
        "strain_mean_us": float(np.mean(every)),
        "us_per_mm": float(every.sum() / travel_mm) if travel_mm > 0.0 else None,
    }


def _travel_to_convergence(sweep: ReplayedSweep) -> float:
    """:func:`travel_from_contact` of the first converged estimate; NaN where there is none."""
    travel = travel_from_contact(sweep)[sweep.converged]
    return float(travel[0]) if len(travel) else np.nan


def _pooled(values: Sequence[np.ndarray], keep: Sequence[np.ndarray] | None = None) -> np.ndarray:
    """Finite values of all sweeps, of the entries selected by ``keep``."""
    if not values:
        return np.empty(0)
    pooled = np.concatenate(values)
    if keep is not None:
        pooled = pooled[np.concatenate(keep)]
    return pooled[np.isfinite(pooled)]
