"""What is wrong with a scan, so that it can be mended before it is used: one line a finding.

Every threshold is a constant here, with its reason; the findings are for a person to judge.
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
from tactile_localizer.offline.figures.axes import MM, shown
from tactile_localizer.scene import Scene

_FEWEST = 50
"""Pairs below which the values of a gauge say nothing about the gauge."""

_MOST_VOLTS = 20.0
"""More than any amplifier of strain gauges gives: rather mV or counts."""

_LEAP = 0.2
"""Share of the scan's extent by which a palm does not move from one sample to the next."""
_LEAP_STEPS = 20.0
"""And in median steps of the sweep, which may be sparse."""
_FEWEST_STEPS = 10

_LOSS = 0.05
"""Share of a sweep's samples lost to gaps, or skipped, that is worth a line."""

_ON_BOUND = 0.02
"""Distance of a sweep from a bound of the scene, as a share of its extent, over which it wobbles."""

_HOLE = 0.85
"""Distance to the nearest pair, in distances of the sweeps, that shows uneven spacing: half a distance is
the most between even ones, a whole one where one is missing."""

_SAME_LINE = 0.01
"""Share of the scene's longest extent within which sweeps, there and back, run on the same line."""

_COVERED = 0.98
"""Less coverage than this is worth a line."""

_DEAD = 0.01
"""A gauge whose range is this share of the typical gauge's feels nothing."""

_AT_LIMIT = 0.01
"""Share of samples at exactly the highest or lowest value from which a gauge seems cut off. Of noisy
values not cut off, one sample is the highest; of coarse counts, a few are."""

_DISAGREEMENT = 3.0
"""Residual of a sweep, against what the sweeps around it felt, in residuals of the median sweep."""

_COMPARED = 50_000
"""Pairs that sweeps are compared by, evenly chosen from more: their median says as much."""

_DRIFT = 5.0
"""Trend of a gauge over the scan, in standard deviations of the sweeps' medians around it; chance makes
one of 3 in a hundredth of the gauges."""

_DRIFT_SWEEPS = 6


def findings(
    scan: Scan,
    scene: Scene,
    sweeps: Sequence[SweepInfo],
    unit: str = "V",
    progress: Callable[[float], None] = lambda share: None,
) -> list[str]:
    """Everything about a scan that may need mending.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds
    sweeps : what the scan file says of the sweeps; dropped ones are passed over
    unit : of the strain
    progress : called with the share of the checks that is done, 0 to 1
    """
    kept = [sweep for sweep in sweeps if not sweep.dropped]
    checks = (
        _amount(scan),
        _recording(kept),
        _leaps(scan),
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
    if len(scan) < _FEWEST:
        yield f"only {len(scan)} pairs: too few to judge the gauges"
    if len(scan.sweep_numbers) == 1:
        yield "only one sweep: how sweeps differ is not known, and the noise cannot be estimated well"


def _unit(scan: Scan, unit: str) -> Iterator[str]:
    greatest = float(max(scan.strain.max(), -scan.strain.min()))  # without a second array of that size
    if unit == "V" and greatest > _MOST_VOLTS:
        yield (
            f"strain goes to {greatest:.4g} V: is it in V? (import: --column "
            f"PHALANX=NAME1..{scan.layout.counts[0]}*0.001 "
            "for mV, or strain_unit in the naming)"
        )


def _leaps(scan: Scan) -> Iterator[str]:
    """Sweeps whose palm leaps from one pair to the next, as where a recording of several counts as one."""
    places = scan.states[:, [column for column, axis in enumerate(scan.axes) if axis != "yaw"]]
    if not places.shape[1]:
        return
    least = _LEAP * float(np.ptp(places, axis=0).max())
    for number in scan.sweep_numbers:
        steps = np.linalg.norm(np.diff(places[scan.sweep == number], axis=0), axis=1)
        if len(steps) < _FEWEST_STEPS:
            continue
        leaps = steps[steps > max(least, _LEAP_STEPS * float(np.median(steps)))]
        if len(leaps):
            yield (
                f"sweep {number}: the palm leaps by {leaps.max() * MM:.1f} mm, {len(leaps)} in all: "
                "is it one sweep, without gaps?"
            )


def _recording(sweeps: Sequence[SweepInfo]) -> Iterator[str]:
    for sweep in sweeps:
        if not sweep.ended:
            yield f"sweep {sweep.number}: its recording was cut off after {sweep.pairs} pairs"
        total = sweep.pairs + sweep.gaps + sweep.skipped
        if sweep.gaps > _LOSS * total:
            yield f"sweep {sweep.number}: {sweep.gaps} of {total} samples fell into gaps of the palm poses"
        if sweep.skipped > _LOSS * total:
            reasons = "missing, saturated or out of bounds"
            yield f"sweep {sweep.number}: {sweep.skipped} of {total} samples were {reasons}"


def _along_bounds(scan: Scan, scene: Scene, sweeps: Sequence[SweepInfo]) -> Iterator[str]:
    """Sweeps that lost samples and lie on a bound of the scene, over which a hand wobbles."""
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
                        f"sweep {sweep.number}: lies on the bound {axis.name} {shown(axis.name, bound):.1f}, "
                        f"{lost} samples were left out: give the scene's bounds a margin"
                    )


def _coverage(scan: Scan, scene: Scene) -> Iterator[str]:
    """Over a plane, holes between the sweeps, by their own distance; else the share that is covered."""
    is_plane = "y" in scan.axes and "x" in scan.axes
    extent = max(axis.upper - axis.lower for axis in scene.axes if axis.name != "yaw" or not is_plane)
    distance = sweep_distance(scan, _SAME_LINE * extent) if is_plane else 0.0
    if not distance:
        coverage = Coverage(scene)
        coverage.add(scan.states)
        if coverage.share < _COVERED:
            yield f"coverage: only {coverage.share:.0%} of the scene's bounds lie near a pair"
        return
    coverage = Coverage(scene, distance)
    coverage.add(scan.states)
    place, hole = coverage.largest_hole()
    if hole > _HOLE:
        where = ", ".join(
            f"{axis} {shown(axis, value):.1f}" for axis, value in zip(scan.axes, place, strict=True)
        )
        yield (
            f"uneven spacing: sweeps are {distance * MM:.1f} mm apart, but the nearest pair to {where} "
            f"is {hole * distance * MM:.1f} mm away"
        )


def _gauges(scan: Scan) -> Iterator[str]:
    if len(scan) < _FEWEST:
        return
    high, low = scan.strain.max(axis=0), scan.strain.min(axis=0)
    typical = float(np.median(high - low))
    for column in range(scan.strain.shape[1]):
        name = _element(scan, column)
        if high[column] - low[column] <= _DEAD * typical:
            yield f"{name}: seems dead, all values lie within {high[column] - low[column]:.3g}"
            continue
        values = scan.strain[:, column]
        for limit in (low[column], high[column]):
            share = float(np.mean(values == limit))
            # Many sensors give 0 where nothing is touched: that is rest, not the end of a range.
            if share > _AT_LIMIT and limit != 0.0:
                yield f"{name}: seems saturated, {share:.1%} of the values are exactly {limit:.6g}"


def _element(scan: Scan, column: int) -> str:
    """A channel's name for people: the phalanx, and its number there."""
    phalanx, channel = scan.layout.place(column)
    return f"{scan.phalanges[phalanx]} element {channel}"


def _disagreement(scan: Scan) -> Iterator[str]:
    """Each sweep against the nearest pairs of the others."""
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
            times = f"{residual / typical:.1f} times as much as others do"
            yield f"sweep {number}: differs from the sweeps around it {times}"


def _drift(scan: Scan) -> Iterator[str]:
    """A trend of the sweeps' medians, which a feature that fills less than half of a sweep does not move."""
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
        name = _element(scan, column)
        times = abs(total[column]) / max(scatter[column], 1e-300)
        yield f"{name}: drifts by {total[column]:+.3g} over the scan, {times:.0f} times its scatter"
