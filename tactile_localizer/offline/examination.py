"""The examination of a scan in words: what its held-out sweeps show, and what needs attention."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.examination import Examination, Outcome, by_chance
from tactile_localizer.errors import counted, listed
from tactile_localizer.offline.axes import MM, describe_sizes
from tactile_localizer.scene import Scene

_OBSERVED = 0.5
"""Part of what there is to know along an axis from which the axis is observed. By judgement."""
_FEW = 3
"""Sweeps below which an examination says little."""


def describe_examination(scene: Scene, examination: Examination) -> list[str]:
    """What to expect on a scan, one line for each thing; empty if nothing could be held out."""
    on_map, off_map = examination.on_map, examination.off_map
    if not on_map:
        return []
    never = sum(not each.converged for each in on_map)
    lines = [
        f"{len(on_map)} trials of {counted(_sweeps(on_map), 'held-out sweep')}: "
        f"{sum(each.right for each in on_map)} right at the end, "
        f"{sum(each.wrong for each in on_map)} ever wrong, "
        f"{sum(each.lost for each in on_map)} converged and lost again, {never} never converged"
    ]
    if len(examination.error):
        lines.append(f"error of those: {describe_sizes(scene, examination.error)}")
    if off_map:
        wrong = sum(each.converged for each in off_map)
        lines.append(f"{len(off_map)} trials on material that is not on the map: {wrong} ever converged")
    lines.append(
        "they are of the force and the session of the scan: to see what another force or day costs, replay "
        "some sweeps that were recorded with another grip"
    )
    lines.append(
        f"score {examination.score:.2f} (0: sure and right; {examination.ignorance:.2f}: no better than "
        f"ignorance), information length {examination.information_length * MM:.1f} mm"
    )
    return lines


def examination_findings(scene: Scene, examination: Examination) -> list[str]:
    """What needs attention, one line for each kind."""
    on_map, found = examination.on_map, []
    if not on_map:
        return ["examination: no sweep could be held out; record at least two"]
    names, observed = scene.axis_names, examination.observed >= _OBSERVED
    width = np.sqrt(12.0) * examination.spread
    if not observed.any():
        found.append(
            f"the held-out sweeps do not know where they are (score {examination.score:.2f}, of ignorance "
            f"{examination.ignorance:.2f}): nothing that was scanned distinguishes places, or the sweeps "
            "differ too much"
        )
    else:
        for name, one, extent in zip(names, observed, scene.extent, strict=True):
            if not one:
                least = float(width[names.index(name)])
                known = [other for other, yes in zip(names, observed, strict=True) if yes]
                unit = "rad" if name == "yaw" else "mm"
                factor = 1.0 if name == "yaw" else MM
                found.append(
                    f"{name} is not known better than {factor * min(least, extent):.3g} {unit} along "
                    f"{factor * extent:.3g} {unit}: nothing that was scanned distinguishes places along it; "
                    f"scan something that does, or name {listed(known)} alone in the scene"
                )
    converged = sum(each.converged for each in on_map)
    if observed.any() and (2 * converged < len(on_map) or examination.score < examination.ignorance):
        alike = np.abs([each.alike for each in on_map if each.alike])
        why = "the sweeps differ from each other by as much as places do"
        if 2 * len(alike) > len(on_map) - converged:
            apart = describe_sizes(scene, np.median(alike, axis=0))
            why = f"places that are {apart} apart feel alike, until something else is felt"
        found.append(f"only {converged} of {counted(len(on_map), 'trial')} converged: {why}")
    if wrong := sorted({each.sweep + 1 for each in on_map if each.wrong}):
        found.append(f"converged at a wrong place in the examination: sweep {listed(map(str, wrong))}")
    false = sum(each.converged for each in examination.off_map)
    if false > by_chance(len(examination.off_map)):
        found.append(
            f"{false} of {len(examination.off_map)} trials converge on material that is not on the map: "
            "it resembles itself, and other material of its kind may be taken for it"
        )
    if _sweeps(on_map) < _FEW:
        found.append(f"examination: only {_sweeps(on_map)} sweeps, which says little; record more")
    return found


def examination_document(examination: Examination) -> dict[str, Any]:
    """The examination for JSON, in SI units."""
    return {**dataclasses.asdict(examination), "score": examination.score}


def _sweeps(outcomes: Sequence[Outcome]) -> int:
    return len({each.sweep for each in outcomes})
