"""The examination of a scan in words: what its held-out sweeps show, and what needs attention."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.examination import Examination, conceded
from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.errors import counted, listed
from tactile_localizer.offline.axes import MM, describe_sizes, display_units
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
        f"{_trials(on_map)}, each on a map without it: "
        f"{sum(each.right for each in on_map)} right at the end, "
        f"{sum(each.wrong for each in on_map)} ever wrong, "
        f"{sum(each.lost for each in on_map)} converged and lost again, {never} never converged"
    ]
    if len(examination.error):
        lines.append(f"mean error of those that are right: {describe_sizes(scene, examination.error)}")
    if off_map:
        wrong = sum(each.converged for each in off_map)
        lines.append(
            f"{_trials(off_map)}, each on a map without its surroundings, "
            "as on material that was not scanned: "
            f"{wrong} converged{', which is wrong' * (wrong > 0)}"
        )
    if others := [each for each in on_map if each.other_session]:
        right = sum(each.right for each in others)
        lines.append(f"{_trials(others)} of them on a map of other sessions: {right} right at the end")
    else:
        lines.append(
            "nothing is known of another force or another day: scan some lines again so, in another session"
        )
    lines.append(
        f"{_probabilities(examination)}; one independent measurement of the position per "
        f"{examination.information_length * MM:.1f} mm of travel, of whether this is the map per "
        f"{examination.explanation_length * MM:.1f} mm"
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
            f"the sweeps left out are not localized ({_probabilities(examination)}): "
            "nothing that was scanned distinguishes places, or the sweeps differ too much"
        )
    else:
        for name, one, extent in zip(names, observed, scene.extent, strict=True):
            if not one:
                least = float(width[names.index(name)])
                known = [other for other, yes in zip(names, observed, strict=True) if yes]
                unit = "rad" if name == "yaw" else "mm"
                factor = 1.0 if name == "yaw" else MM
                found.append(
                    f"{name} cannot be localized: {factor * min(least, extent):.3g} of the "
                    f"{factor * extent:.3g} {unit} remain possible at the end of a sweep; "
                    f"scan something that distinguishes places along {name}, "
                    f"or leave {name} out of the scene (axes: {listed(known)})"
                )
    converged = sum(each.converged for each in on_map)
    if observed.any() and (2 * converged < len(on_map) or examination.score < examination.ignorance):
        why = _why_few(scene, on_map, [name for name, yes in zip(names, observed, strict=True) if not yes])
        found.append(f"only {converged} of {_trials(on_map)} converged: {why}")
    elif 2 * sum(each.right for each in on_map) < len(on_map) and (lost := [o for o in on_map if o.lost]):
        found.append(f"{len(lost)} of {_trials(on_map)} are lost again{_behind(scene, lost)}")
    if wrong := sorted({each.sweep + 1 for each in on_map if each.wrong}):
        found.append(f"converged at a wrong place in the examination: sweep {listed(map(str, wrong))}")
    false = sum(each.converged for each in examination.off_map)
    if false > conceded(len(examination.off_map)):
        found.append(
            f"{false} of {_trials(examination.off_map)} converge on a map without their surroundings: "
            "places resemble each other, and material that was not scanned may be taken for one of them"
        )
    if _sweeps(on_map) < _FEW:
        found.append(f"examination: only {_sweeps(on_map)} sweeps, which says little; record more")
    return found


def _why_few(scene: Scene, on_map: Sequence[Outcome], unknown: Sequence[str]) -> str:
    """Why few sweeps ``on_map`` converge, where the axes ``unknown`` cannot be localized."""
    if unknown:
        return f"the position along {listed(unknown)} stays open"
    alike = np.abs([each.alike for each in on_map if each.alike])
    if 2 * len(alike) > sum(not each.converged for each in on_map):
        apart = describe_sizes(scene, np.median(alike, axis=0))
        return f"places that are {apart} apart feel alike, until something else is felt"
    return "the sweeps differ from each other by as much as places do"


def _behind(scene: Scene, lost: Sequence[Outcome]) -> str:
    """The middle half of the places where the sweeps were last known, as text.

    Axes over more than half of which these places are spread are left out.
    """
    places = np.quantile([each.last_known for each in lost], [0.25, 0.75], axis=0)
    within = []
    for axis, low, high, extent in zip(scene.axis_names, *places, scene.extent, strict=True):
        if high - low <= 0.5 * extent:
            unit = "°" if axis == "yaw" else " mm"
            within.append(f"{axis} {display_units(axis, low):.0f} to {display_units(axis, high):.0f}{unit}")
    return f", half of them behind {', '.join(within)}" if within else ", all over the scan"


def examination_document(examination: Examination) -> dict[str, Any]:
    """The examination for JSON, in SI units."""
    return {**dataclasses.asdict(examination), "score": examination.score}


def _trials(outcomes: Sequence[Outcome]) -> str:
    """How many sweeps, or parts of them, were localized."""
    sweeps = counted(_sweeps(outcomes), "sweep")
    return sweeps if len(outcomes) == _sweeps(outcomes) else f"{len(outcomes)} parts of {sweeps}"


def _probabilities(examination: Examination) -> str:
    """The score as a probability, beside those of ignorance and of certainty."""
    found, guess = np.exp([examination.score, examination.ignorance])
    return f"probability of the true place {found:.2g} on average (a blind guess: {guess:.2g}, certainty: 1)"


def _sweeps(outcomes: Sequence[Outcome]) -> int:
    return len({each.sweep for each in outcomes})
