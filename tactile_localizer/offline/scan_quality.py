"""Checks of a scan: coverage, gaps, dead or saturated gauges, drift; one line per finding.

The thresholds are judgement, each with its reason; the user decides what to do about a finding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import sweep_distance
from tactile_localizer.io.scans.rows import SweepInfo
from tactile_localizer.offline.axes import MM, display_units
from tactile_localizer.scene import Scene

_MIN_PAIRS = 50
"""Pairs below which a gauge cannot be checked."""

_MAX_VOLTS = 20.0
"""Above the range of strain gauge amplifiers: likely mV or counts."""

_JUMP = 0.2
"""Step between samples that counts as a jump, as a fraction of the scan's extent ..."""
_JUMP_STEPS = 20.0
"""... and in median steps of the sweep, which may be sparsely sampled."""
_MIN_STEPS = 10

_LOSS = 0.05
"""Fraction of a sweep's samples lost to gaps, or skipped, that is reported."""

_ON_BOUND = 0.02
"""Distance of a sweep from a bound within which the hand crosses it, as a fraction of the extent."""

_HOLE = 0.85
"""Distance to the nearest pair at which spacing is uneven, in sweep distances: at most 0.5 between evenly
spaced sweeps, 1 where a sweep is missing."""

_SAME_LINE = 0.01
"""Distance within which sweeps are on the same line (there and back), as a fraction of the longest extent."""

_COVERED = 0.98
"""Coverage below which it is reported."""

_DEAD = 0.01
"""Range of a dead gauge, as a fraction of the median gauge's."""

_AT_LIMIT = 0.01
"""Fraction of samples at exactly the highest or lowest value from which a gauge seems saturated. Noisy values
have one highest sample, coarse counts a few."""

_DISAGREEMENT = 3.0
"""Residual of a sweep against its neighbouring sweeps that is reported, in residuals of the median sweep."""

_COMPARED = 50_000
"""Pairs by which sweeps are compared, evenly chosen from more: the median needs no more."""

_DRIFT = 5.0
"""Trend of a gauge over the scan that is reported, in standard deviations of the sweeps' medians about it. By
chance one gauge in a hundred has a trend of 3."""

_DRIFT_SWEEPS = 6


def findings(
    scan: Scan,
    scene: Scene,
    sweeps: Sequence[SweepInfo],
    unit: str = "V",
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[str]:
    """Findings about a scan that may need attention.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds
    sweeps : as recorded in the scan file; dropped ones are ignored
    unit : of the strain
    progress : called with the completed fraction of the checks, 0 to 1
    """
    kept = [sweep for sweep in sweeps if not sweep.dropped]
    checks = (
        _amount(scan),
        _recording(kept),
        _jumps(scan),
        _along_bounds(scan, scene, kept),
        _coverage(scan, scene),
        _unit(scan, unit),
        _gauges(scan),
        _disagreement(scan),
        _drift(scan),
    )
    found: list[str] = []
    for done, check in enumerate(checks, start=1):
        found += check
        progress(done / len(checks))
    return found


def _amount(scan: Scan) -> Iterator[str]:
    if len(scan) < _MIN_PAIRS:
        yield f"only {len(scan)} pairs: too few to check the gauges"
    if len(scan.sweep_numbers) == 1:
        yield "only one sweep: the noise between sweeps cannot be estimated"


def _unit(scan: Scan, unit: str) -> Iterator[str]:
    greatest = float(max(scan.strain.max(), -scan.strain.min()))  # no second array of that size
    if unit == "V" and greatest > _MAX_VOLTS:
        yield (
            f"strain goes to {greatest:.4g} V: is it in V? (import: --column "
            f"PHALANX=NAME1..{scan.layout.counts[0]}*0.001 "
            "for mV, or strain_unit in the naming)"
        )


def _jumps(scan: Scan) -> Iterator[str]:
    """Sweeps in which the palm jumps, as where a recording of several sweeps is taken for one."""
    places = scan.states[:, [column for column, axis in enumerate(scan.axes) if axis != "yaw"]]
    if not places.shape[1]:
        return
    least = _JUMP * float(np.ptp(places, axis=0).max())
    for number in scan.sweep_numbers:
        steps = np.linalg.norm(np.diff(places[scan.sweep == number], axis=0), axis=1)
        if len(steps) < _MIN_STEPS:
            continue
        jumps = steps[steps > max(least, _JUMP_STEPS * float(np.median(steps)))]
        if len(jumps):
            yield (
                f"sweep {number}: the palm jumps by up to {jumps.max() * MM:.1f} mm, {len(jumps)} times: "
                "is it one sweep, without gaps?"
            )


def _recording(sweeps: Sequence[SweepInfo]) -> Iterator[str]:
    for sweep in sweeps:
        if not sweep.ended:
            yield f"sweep {sweep.number}: its recording ended early, after {sweep.pairs} pairs"
        total = sweep.pairs + sweep.gaps + sweep.skipped
        if sweep.gaps > _LOSS * total:
            yield f"sweep {sweep.number}: {sweep.gaps} of {total} samples fell into gaps of the palm poses"
        if sweep.skipped > _LOSS * total:
            reasons = "missing, saturated or out of bounds"
            yield f"sweep {sweep.number}: {sweep.skipped} of {total} samples were {reasons}"


def _along_bounds(scan: Scan, scene: Scene, sweeps: Sequence[SweepInfo]) -> Iterator[str]:
    """Sweeps that lost samples because they follow a bound of the scene, which the hand crosses."""
    columns = scene.columns(scan.axes)
    for sweep in sweeps:
        if not sweep.skipped or sweep.skipped > 9 * sweep.pairs:
            continue
        place = np.median(scan.states[scan.sweep == sweep.number][:, columns], axis=0)
        for axis, at in zip(scene.axes, place, strict=True):
            for bound in np.array([axis.lower, axis.upper]):
                if abs(at - bound) < _ON_BOUND * (axis.upper - axis.lower) and not axis.wraps:
                    lost = f"{sweep.skipped} of {sweep.pairs + sweep.gaps + sweep.skipped}"
                    yield (
                        f"sweep {sweep.number}: follows the bound {axis.name} "
                        f"{display_units(axis.name, bound):.1f}, "
                        f"{lost} samples were left out: widen the scene's bounds"
                    )


def _coverage(scan: Scan, scene: Scene) -> Iterator[str]:
    """In a plane, gaps between sweeps relative to their distance; otherwise the covered fraction."""
    is_plane = "y" in scan.axes and "x" in scan.axes
    extent = max(axis.upper - axis.lower for axis in scene.axes if axis.name != "yaw" or not is_plane)
    distance = sweep_distance(scan, _SAME_LINE * extent) if is_plane else 0.0
    if not distance:
        coverage = Coverage(scene)
        coverage.add(scan.states)
        if coverage.fraction < _COVERED:
            yield f"coverage: only {coverage.fraction:.0%} of the scene's bounds lie near a pair"
        return
    coverage = Coverage(scene, distance)
    coverage.add(scan.states)
    place, hole = coverage.largest_hole()
    if hole > _HOLE:
        where = ", ".join(
            f"{axis} {display_units(axis, value):.1f}" for axis, value in zip(scan.axes, place, strict=True)
        )
        yield (
            f"uneven spacing: sweeps are {distance * MM:.1f} mm apart, but the nearest pair to {where} "
            f"is {hole * distance * MM:.1f} mm away"
        )


def _gauges(scan: Scan) -> Iterator[str]:
    if len(scan) < _MIN_PAIRS:
        return
    high, low = scan.strain.max(axis=0), scan.strain.min(axis=0)
    typical = float(np.median(high - low))
    for column in range(scan.strain.shape[1]):
        name = _channel_name(scan, column)
        if high[column] - low[column] <= _DEAD * typical:
            yield f"{name}: seems dead, all values lie within {high[column] - low[column]:.3g}"
            continue
        values = scan.strain[:, column]
        for limit in (low[column], high[column]):
            fraction = float(np.mean(values == limit))
            # Many sensors read 0 without contact, which is not the end of their range.
            if fraction > _AT_LIMIT and limit != 0.0:
                yield f"{name}: seems saturated, {fraction:.1%} of the values are exactly {limit:.6g}"


def _channel_name(scan: Scan, column: int) -> str:
    """Name of a channel for the user: its phalanx and number."""
    phalanx, channel = scan.layout.place(column)
    return f"{scan.phalanges[phalanx]} channel {channel}"


def _disagreement(scan: Scan) -> Iterator[str]:
    """Residual of each sweep against the nearest pairs of the others."""
    if len(scan.sweep_numbers) < 3:
        return
    if len(scan) > _COMPARED:
        scan = scan.select(np.arange(0, len(scan), math.ceil(len(scan) / _COMPARED)))
        if len(scan.sweep_numbers) < 3:
            return
    scale = np.maximum(scan.strain.std(axis=0), 1e-300)
    residuals = {}
    for number in scan.sweep_numbers:
        mine = scan.sweep == number
        _, near = cKDTree(scan.states[~mine]).query(scan.states[mine])
        difference = (scan.strain[mine] - scan.strain[~mine][near]) / scale
        residuals[number] = float(np.median(np.sqrt(np.mean(difference**2, axis=1))))
    typical = float(np.median(list(residuals.values())))
    for number, residual in residuals.items():
        if residual > _DISAGREEMENT * typical:
            times = f"{residual / typical:.1f} times as much as the median sweep"
            yield f"sweep {number}: differs from the sweeps around it {times}"


def _drift(scan: Scan) -> Iterator[str]:
    """Trend of the sweeps' medians, which a feature on less than half of a sweep does not affect."""
    numbers = scan.sweep_numbers
    if len(numbers) < _DRIFT_SWEEPS:
        return
    medians = np.array([np.median(scan.strain[scan.sweep == number], axis=0) for number in numbers])
    order = np.arange(len(numbers)) - (len(numbers) - 1) / 2
    slope = order @ medians / (order @ order)
    rest = medians - medians.mean(axis=0) - np.outer(order, slope)
    scatter = np.sqrt(np.sum(rest**2, axis=0) / (len(numbers) - 2))
    total = slope * (len(numbers) - 1)
    for column in np.flatnonzero(np.abs(total) > _DRIFT * np.maximum(scatter, 1e-300)).tolist():
        name = _channel_name(scan, column)
        times = abs(total[column]) / max(scatter[column], 1e-300)
        yield f"{name}: drifts by {total[column]:+.3g} over the scan, {times:.0f} times its scatter"
