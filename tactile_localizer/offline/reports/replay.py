"""The report of a replay."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np

from tactile_localizer.core.localizer import Localizer
from tactile_localizer.errors import MeasurementError, counted
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.axes import MM, describe_sizes
from tactile_localizer.offline.examination import examination_findings
from tactile_localizer.offline.figures.belief import belief_figure, progress_figure
from tactile_localizer.offline.figures.replay import paths_figure, replay_figure
from tactile_localizer.offline.metrics import position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.offline.replay_document import Evaluation
from tactile_localizer.offline.reports.page import (
    WIDTH_IN,
    Section,
    file_names,
    html_page,
    page_style,
    sentence,
    versions,
    yaml_text,
)
from tactile_localizer.offline.reports.parts import examination_sections, map_section
from tactile_localizer.offline.verdict import Outcome, judge, outcome, relative_error, worst_sweep

_NOTES = 12
"""Most notes beside the verdict."""
_MOMENTS = 4
"""Moments of the worst sweep at which its belief is shown."""
_QUALITY = {Outcome.RIGHT: "good", Outcome.NO_CONTACT: ""}
"""Classes of the rows of sweeps; others are bad."""


@page_style
def replay_report(evaluation: Evaluation, document: Mapping[str, Any], notes: Sequence[str]) -> str:
    """The report of a replay, HTML; it localizes the worst sweep again.

    Parameters
    ----------
    evaluation : the replay
    document : what :func:`~.replay_document.replay_document` made of it
    notes : lines about the recording that need attention
    """
    verdict, examination = evaluation.verdict, evaluation.calibration.examination
    explained = "The true positions are unknown, so a sweep that converged may be wrong."
    if verdict.has_truth:
        radius = describe_sizes(evaluation.scene, evaluation.localizer.criteria.radius)
        explained = f"Right: converged at the end of contact or sweep, and never off by more than {radius}."
        explained += " Early: before contact." * (verdict.early > 0)
    sections = [
        *examination_sections(
            examination, evaluation.scene, examination_findings(evaluation.scene, examination)
        ),
        map_section(evaluation.load(), evaluation.scene, evaluation.replayed.strain_unit),
        *_sweeps(evaluation.sweeps),
        *_worst_sweep(evaluation),
        _settings(evaluation, document),
    ]
    return html_page(
        kind="Replay of a recording",
        title=f"{file_names(evaluation.replayed.source)} on {file_names(evaluation.scan_name)}",
        good=verdict.success,
        verdict=sentence(str(verdict)),
        explained=explained,
        notes=_first([*notes, *verdict.notes]),
        tiles=_tiles(document),
        sections=sections,
    )


def _tiles(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The figures that a reader looks for first, with what they are."""
    summary, verdict, timing = document["summary"], document["verdict"], document["timing"]
    outcome = "right" if verdict["has_truth"] else "converged"
    tiles = [(f"{verdict['right']} of {verdict['expected']}", f"sweeps {outcome}")]
    if verdict["has_truth"]:
        tiles.append((str(verdict["wrong"]), "sweeps ever wrong"))
    error, arrived = summary["error_converged_m"], summary["travel_to_convergence_m"]
    if error["count"]:
        largest = f"error while converged, median; {error['max'] * MM:.1f} mm at most"
        tiles.append((f"{error['median'] * MM:.1f} mm", largest))
    if arrived["count"]:
        place = "contact" if summary["contacts"] else "the start"
        tiles.append((f"{arrived['median'] * MM:.1f} mm", f"from {place} to convergence, median"))
    if summary["coverage_95"] is not None:
        tiles.append((f"{100.0 * summary['coverage_95']:.1f} %", "of the positions in the 95 % region"))
    if timing["update_median_us"] is not None:
        tiles.append((f"{timing['update_median_us'] / 1e3:.1f} ms", "per measurement update, median"))
    return tiles


def _sweeps(sweeps: Sequence[ReplayedSweep]) -> list[Section]:
    """Error along the sweeps, where they converge, and a row for each; none without sweeps."""
    if not sweeps:
        return []
    columns = (
        "sweep",
        "outcome",
        "converged after, mm",
        "error at the end, mm",
        "largest, converged, mm",
        "reason",
    )
    rows = []
    for sweep in sweeps:
        found, error = outcome(sweep), MM * position_error(sweep)
        claimed = error[sweep.converged & np.isfinite(error)]
        arrived = MM * travel_from_contact(sweep)[sweep.converged]
        numbers = map(_number, (arrived, error[-1:], np.sort(claimed)[-1:]))
        reason = "" if found is Outcome.RIGHT else "".join(sweep.reason[-1:])
        name = "converged" if found is Outcome.RIGHT and sweep.truth is None else found.value
        rows.append((_QUALITY.get(found, "bad"), (str(sweep.number), name, *numbers, reason)))
    table = Section(f"{counted(len(rows), 'sweep')}", columns=columns, numbers=columns[2:5], rows=rows)
    size_in = WIDTH_IN, WIDTH_IN
    figures = [
        (
            replay_figure(sweeps, size_in),
            "Error, where the truth is known, and standard deviation of the estimate along each sweep.",
        ),
        (paths_figure(sweeps, WIDTH_IN), "Where the palm was, and what the estimate claimed there."),
    ]
    return [Section("Error along the sweeps", figures=figures, folded=[table])]


def _worst_sweep(evaluation: Evaluation) -> list[Section]:
    """The sweep that a reader wants to see first, with its belief; none where no sample was usable."""
    worst = worst_sweep(evaluation.sweeps)
    if worst is None:
        return []
    sweep = evaluation.sweeps[worst]
    moments = _moments(sweep)
    beliefs = _beliefs(evaluation.localizer, evaluation.recorded(worst), sweep.row[moments].tolist())
    what = f"sweep {sweep.number} did not converge, and did not have to"
    if sweep.converged.any():
        what = f"sweep {sweep.number} converged after the longest travel"
    lines = [f"{sentence(next(iter(judge([sweep]).notes), what))}."]
    if evaluation.configuration.filter == "particle":
        lines.append("The belief is of another run of the particle filter, with other random numbers.")
    error, travel = MM * position_error(sweep), MM * travel_from_contact(sweep)
    columns = ("moment", "travel, mm", "probability", "error, mm", "reason")
    rows = []
    for letter, at in zip("ABCDEFGH", moments, strict=False):
        numbers = f"{travel[at]:.1f}", f"{sweep.probability[at]:.3f}", _number(error[at:])
        rows.append(("", (letter, *numbers, sweep.reason[at])))
    caption = f"The belief at {counted(len(moments), 'moment')}"
    caption += "; darker is more probable" if sweep.scene.dimension > 1 else ""
    caption += ", the true position is in the middle of the red cross." if sweep.truth is not None else "."
    figures = [
        (belief_figure(sweep, moments, beliefs, WIDTH_IN), caption),
        (
            progress_figure(sweep, moments, (WIDTH_IN, 0.8 * WIDTH_IN)),
            "Probability and error along the sweep; dashed: the threshold.",
        ),
    ]
    return [Section("The worst sweep", lines, figures, columns, columns[1:4], rows)]


def _moments(sweep: ReplayedSweep) -> list[int]:
    """Estimates to show: contact, the most wrong claim or convergence, the end, and between them."""
    error = relative_error(sweep)
    first = int(np.searchsorted(sweep.row[:-1], max(sweep.contact[0], 0)))
    converged = np.flatnonzero(sweep.converged)
    best = int(converged[0]) if len(converged) else int(np.argmax(sweep.probability))
    shown = int(np.argmax(error)) if (error > 1.0).any() else best
    found = {first, shown, len(sweep) - 1}
    while len(found) < _MOMENTS and np.diff(at := sorted(found)).max(initial=0) > 1:
        gap = int(np.diff(at).argmax())
        found.add((at[gap] + at[gap + 1]) // 2)
    return sorted(found)


def _beliefs(
    localizer: Localizer, sweep: RecordedSweep, rows: Sequence[int]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Localize a sweep again; its belief (states and weights) at some rows."""
    localizer.reset()
    found = []
    for row, sample in enumerate(sweep.samples()):
        with suppress(MeasurementError):
            localizer.update(*sample)
        if row in rows:
            found.append(localizer.hypotheses())
    return found


def _settings(evaluation: Evaluation, document: Mapping[str, Any]) -> Section:
    """Everything that is needed to repeat the replay."""
    summary = document["summary"]
    rows = [
        ("", row)
        for row in (
            ("recording", evaluation.replayed.source),
            ("scan", evaluation.scan_name),
            ("samples", f"{summary['strains']:,} in {counted(summary['sweeps'], 'sweep')}"),
            ("odometry", evaluation.replayed.odometry),
            ("seed", str(evaluation.seed)),
            *document["learned"].items(),
        )
    ]
    return Section(
        "Configuration and versions",
        rows=[*rows, *versions()],
        folded=[
            Section("Configuration", code=yaml_text(asdict(evaluation.configuration))),
            Section("Scene", code=yaml_text(scene_to_dict(evaluation.scene))),
        ],
    )


def _first(notes: Sequence[str]) -> list[str]:
    """The first of many notes, and how many more there are."""
    more = len(notes) - _NOTES
    return [*notes[:_NOTES], *([f"and {more} more, which the table of the sweeps has"] if more > 0 else [])]


def _number(values: np.ndarray) -> str:
    """The first value with a decimal; empty where there is none or it is unknown."""
    return f"{values[0]:.1f}" if len(values) and np.isfinite(values[0]) else ""
