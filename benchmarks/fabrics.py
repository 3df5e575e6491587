"""Localization on recorded fabrics: the maps of a folder against recordings of like and unlike conditions.

    scripts/in_env python benchmarks/fabrics.py DIR [--starts 30] [--json FILE]

A folder holds ``<fabric>_F<force>_V<speed>mmps_<repeat>.csv``. A map is made of repeats 0 and 1 with a scene
of bounds (the scan's length) and two phalanges of eight channels, nothing else; it is localized on repeat 2,
from starts spaced evenly over what leaves 165 mm of travel (half its length, where a recording is shorter
than 330 mm). Of material that has no repeat 1, the first recording is localized on the maps of other fabrics.
The localizer is reset at each start and gets displacements without noise.

A row is a pair of a map and a recording, and its ``kind`` what differs: ``own`` nothing, ``speed`` the speed,
``force`` the force, ``wrong`` the fabric (recordings of the map's signed speed, else of the nearest). *Right*
is an error of at most 5 mm; on a wrong fabric nothing is. *False* is converged and not right. Shares are
between 0 and 1, and over all starts:

``found``
    right after the last strain, converged or not
``error_80_mm``, ``error_160_mm``
    median error at the first strain after so much travel, mm
``converged_right_end``, ``converged_false_end``
    converged and right, converged and not right, after the last strain
``converged_false_starts``
    false after at least one strain
``converged_false_strains``
    share of all strains, of all starts together, after which the estimate is false
``coverage``
    share of the strains after which the estimate is converged whose 95 % region holds the true
    position; none where it never converges
``coverage_40_mm``
    the same of all strains after 40 mm of travel, converged or not
``travel_to_convergence_mm``
    median travel at the first strain that is converged, right or not, mm; a start that never converges counts
    as infinite, and a median that is infinite is none
``learning_s``
    processor time of building the localizer, parameters chosen, s
``update_us``
    median processor time of a measurement update, us
``update_reads``
    the same in reads of the training strains as float32

``--kidnap``: after 80 mm the hand is placed at least 100 mm away, without a reset and without a
displacement. Rows of kind ``own`` and ``speed`` then have

``right_before``
    converged and right at the last strain before
``again_40_mm``
    converged and right at some strain within 40 mm of travel after
``travel_again_mm``
    median travel after until then, mm; none where it is infinite
``false_40_mm``
    false at 40 mm of travel after

The file of ``--json`` has ``arguments``, ``rows`` and ``totals`` (of each kind: shares averaged over its
rows, medians of its other measures, and the worst of each).
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
from fabric_recordings import (
    KINDS,
    Condition,
    FabricMap,
    Pair,
    Perturbation,
    cut,
    find_conditions,
    find_pairs,
    load_map,
    load_sweep,
)
from measures import read_us
from rows import Row, accuracy_parser, measured, print_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.offline.metrics import covered, position_error
from tactile_localizer.offline.replay import replay
from tactile_localizer.offline.tradeoff import named_configuration

TRAVEL = 0.165
"""m, from each start."""
RIGHT = 0.005
"""m of error."""
KIDNAPPED, AWAY, AGAIN = 0.08, 0.1, 0.04
"""m: travel before the hand is placed elsewhere, least distance of that, travel to converge again."""

_SETTLED = 0.04
"""m of travel from which coverage is measured whether or not the estimate is converged."""


@dataclass(frozen=True)
class Attempt:
    """One start: what was estimated after each of n strains.

    Parameters
    ----------
    travel : (n,) m since the start
    error : (n,) m; infinite on a wrong fabric
    covered, converged : (n,) bool
    update_s : (m,) processor time of the measurement updates
    """

    travel: np.ndarray
    error: np.ndarray
    covered: np.ndarray
    converged: np.ndarray
    update_s: np.ndarray

    @property
    def right(self) -> np.ndarray:
        """Converged and right: (n,) bool."""
        return self.converged & (self.error <= RIGHT)

    @property
    def false(self) -> np.ndarray:
        """Converged and not right: (n,) bool."""
        return self.converged & (self.error > RIGHT)

    def at(self, travel: float) -> int | None:
        """Index of the first strain after so much travel; ``None`` where the attempt is shorter."""
        index = int(np.searchsorted(self.travel, travel))
        return index if index < len(self.travel) else None


def localize(
    localizer: Localizer,
    sweep: RecordedSweep,
    travel: np.ndarray,
    wrong: bool,
    drift: np.ndarray | float = 0.0,
) -> Attempt:
    """Localize a recording, from a uniform prior.

    ``travel`` (n, 1) m is what the arm reports, ``drift`` (C,) what is added to the strain per m of it.
    """
    felt = replace(sweep, position=travel, truth=sweep.position, strain=sweep.strain + travel * drift)
    (replayed,) = replay(localizer, Recording("", (felt,)))
    error = position_error(replayed)
    return Attempt(
        travel=travel[:, 0],
        error=np.full_like(error, np.inf) if wrong else error,
        covered=covered(replayed) > 0.0,
        converged=replayed.converged,
        update_s=replayed.seconds[replayed.updated],
    )


def starts_of(sweep: RecordedSweep, length: float, count: int) -> tuple[np.ndarray, float]:
    """Positions of the starts, m, and the travel from each, m, on the first ``length`` m of a recording."""
    length = min(length, float(sweep.position[-1, 0]))
    travel = min(TRAVEL, length / 2)
    return np.linspace(0.0, length - travel, count), travel


def from_all_starts(
    localizer: Localizer,
    sweep: RecordedSweep,
    length: float,
    count: int,
    wrong: bool,
    drift: np.ndarray | float = 0.0,
) -> list[Attempt]:
    """Attempts from starts that are spaced evenly."""
    starts, travel = starts_of(sweep, length, count)
    parts = [cut(sweep, start, start + travel) for start in starts]
    return [localize(localizer, part, part.position - part.position[0], wrong, drift) for part in parts]


def measures(attempts: Sequence[Attempt], wrong: bool) -> Row:
    """The measures of a row, as the module's docstring defines them."""
    converged = np.concatenate([attempt.converged for attempt in attempts])
    false = np.concatenate([attempt.false for attempt in attempts])
    covered = np.concatenate([attempt.covered for attempt in attempts])
    settled = np.concatenate([attempt.travel >= _SETTLED for attempt in attempts])
    return {
        "found": None if wrong else _mean([attempt.error[-1] <= RIGHT for attempt in attempts]),
        "error_80_mm": None if wrong else _error_mm(attempts, 0.08),
        "error_160_mm": None if wrong else _error_mm(attempts, 0.16),
        "converged_right_end": None if wrong else _mean([attempt.right[-1] for attempt in attempts]),
        "converged_false_end": _mean([attempt.false[-1] for attempt in attempts]),
        "converged_false_starts": _mean([attempt.false.any() for attempt in attempts]),
        "converged_false_strains": _mean(false),
        "coverage": None if wrong else _mean(covered[converged]),
        "coverage_40_mm": None if wrong else _mean(covered[settled]),
        "travel_to_convergence_mm": _median_mm(
            [_first(attempt.travel, attempt.converged) for attempt in attempts]
        ),
    }


def kidnapped(
    localizer: Localizer, sweep: RecordedSweep, length: float, count: int, drift: np.ndarray | float = 0.0
) -> Row:
    """The measures of ``--kidnap``."""
    starts, travel = starts_of(sweep, length, count)
    before, again, false, taken = [], [], [], []
    for number, start in enumerate(starts):
        left = start + KIDNAPPED
        elsewhere = starts[np.abs(starts - left) >= AWAY]
        if not len(elsewhere):
            continue
        place = np.random.default_rng(number).choice(elsewhere)
        first = cut(sweep, start, left)
        second = cut(sweep, place, place + travel - KIDNAPPED)
        attempt = localize(localizer, *_joined(first, second), wrong=False, drift=drift)
        n = len(first.position)
        since = attempt.travel[n:] - attempt.travel[n]
        before.append(attempt.right[n - 1])
        taken.append(_first(since, attempt.right[n:]))
        again.append(taken[-1] <= AGAIN)
        at = min(int(np.searchsorted(since, AGAIN)), len(since) - 1)
        false.append(attempt.false[n + at])
    return {
        "right_before": _mean(before),
        "again_40_mm": _mean(again),
        "travel_again_mm": _median_mm(taken),
        "false_40_mm": _mean(false),
    }


def _joined(first: RecordedSweep, second: RecordedSweep) -> tuple[RecordedSweep, np.ndarray]:
    """One sweep after the other without a displacement between them, and the travel that the arm reports."""
    step_ns = first.stamp_ns[-1] - first.stamp_ns[-2]
    second = replace(second, stamp_ns=second.stamp_ns - second.stamp_ns[0] + first.stamp_ns[-1] + step_ns)
    gone = first.position - first.position[0]
    names = ("stamp_ns", "position", "strain", "status")
    both = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names}
    joined = replace(first, **both)
    return joined, np.concatenate([gone, gone[-1] + second.position - second.position[0]])


def measure_map(
    mapped: Condition,
    pairs: Sequence[Pair],
    configuration: Configuration,
    perturbation: Perturbation,
    starts: int,
    kidnap: bool,
) -> list[Row]:
    """The rows of one map."""
    fabric = load_map(mapped)
    began = time.process_time()
    localizer = build_localizer(fabric.scan, fabric.scene, configuration, np.random.default_rng(0))
    learning_s = time.process_time() - began
    return [
        {
            "map": mapped.name,
            "recording": pair.recording.name,
            "kind": pair.kind,
            "starts": starts,
            "learning_s": learning_s,
            **_measure_pair(localizer, fabric, pair, perturbation, starts, kidnap),
        }
        for pair in pairs
    ]


def _measure_pair(
    localizer: Localizer, fabric: FabricMap, pair: Pair, perturbation: Perturbation, starts: int, kidnap: bool
) -> Row:
    wrong = pair.kind == "wrong"
    assert pair.recording.tested is not None
    sweep = load_sweep(pair.recording.tested, pair.recording.speed)
    sweep = perturbation.of(sweep, fabric.noise_width)
    drift = perturbation.drift_per_m(fabric.noise_width)
    length = float(sweep.position[-1, 0]) if wrong else fabric.length
    if kidnap:
        return kidnapped(localizer, sweep, length, starts, drift)
    attempts = from_all_starts(localizer, sweep, length, starts, wrong, drift)
    seconds = np.concatenate([attempt.update_s for attempt in attempts])
    update_us = 1e6 * float(np.median(seconds))
    reads = update_us / read_us(fabric.scan)
    return {**measures(attempts, wrong), "update_us": update_us, "update_reads": reads}


def _first(travel: np.ndarray, holds: np.ndarray) -> float:
    """Travel at the first strain for which something holds; infinite where it never does."""
    return float(travel[np.argmax(holds)]) if holds.any() else np.inf


def _error_mm(attempts: Sequence[Attempt], travel: float) -> float | None:
    errors = [attempt.error[at] for attempt in attempts if (at := attempt.at(travel)) is not None]
    return _median_mm(errors)


def _median_mm(values: Sequence[float]) -> float | None:
    median = float(np.median(values)) if len(values) else np.inf
    return 1e3 * median if np.isfinite(median) else None


def _mean(values: Any) -> float | None:
    return float(np.mean(values)) if len(values) else None


_SHARES = {
    "found": ("found", ".3f"),
    "converged_right_end": ("right end", ".3f"),
    "converged_false_end": ("false end", ".3f"),
    "converged_false_starts": ("false starts", ".3f"),
    "converged_false_strains": ("false strains", ".4f"),
    "coverage": ("cover", ".3f"),
    "coverage_40_mm": ("cover 40 mm", ".3f"),
    "right_before": ("right before", ".3f"),
    "again_40_mm": ("again in 40 mm", ".3f"),
    "false_40_mm": ("false at 40 mm", ".3f"),
}
_COLUMNS = _SHARES | {
    "error_80_mm": ("80 mm", ".2f"),
    "error_160_mm": ("160 mm", ".2f"),
    "travel_to_convergence_mm": ("to conv., mm", ".1f"),
    "travel_again_mm": ("to again, mm", ".1f"),
    "learning_s": ("learning, s", ".1f"),
    "update_us": ("update, us", ".0f"),
    "update_reads": ("reads", ".1f"),
}
_LOWEST_IS_WORST = ("found", "converged_right_end", "right_before", "again_40_mm")
_HONEST = (0.90, 0.99)
"""Coverage of the 95 % region that is asked for; the worst is farthest from it."""


def totals(rows: Sequence[Row]) -> list[Row]:
    """Of each kind: shares averaged and medians of other measures over its rows, and the worst of each."""
    answer = []
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        for over, summary in (("all", _typical), ("worst", _worst)):
            if own:
                values = {
                    key: summary(key, _known(key, [row[key] for row in own]))
                    for key in own[0]
                    if key in _COLUMNS
                }
                answer.append({"kind": kind, "over": over, "rows": len(own), **values})
    return answer


def _known(key: str, values: list[float | None]) -> list[float]:
    """Values that count: a travel that is not known is infinite."""
    if key.startswith("travel"):
        return [np.inf if value is None else value for value in values]
    return [value for value in values if value is not None]


def _typical(key: str, values: list[float]) -> float | None:
    if not values:
        return None
    return _finite(float(np.mean(values) if key in _SHARES else np.median(values)))


def _worst(key: str, values: list[float]) -> float | None:
    if not values:
        return None
    if key.startswith("coverage"):
        return max(values, key=lambda share: max(_HONEST[0] - share, share - _HONEST[1]))
    return _finite((min if key in _LOWEST_IS_WORST else max)(values))


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def show(rows: Sequence[Row]) -> None:
    """Print the rows, and below them the totals of each kind."""
    every = totals(rows)
    labelled = [
        {**row, "map": f"{row['kind']}: {row['over']}", "recording": f"{row['rows']} rows"} for row in every
    ]
    print_rows(("map", "recording", "kind", "starts"), _COLUMNS, rows, labelled)


def _order(row: Row) -> tuple[Any, ...]:
    return KINDS.index(row["kind"]), row["map"], row["recording"]


def _matching(patterns: Sequence[str]) -> Callable[[Condition], bool]:
    return lambda condition: any(fnmatch(condition.name, pattern) for pattern in patterns)


def main() -> None:
    """Measure, print and write."""
    parser = accuracy_parser(__doc__)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--maps", nargs="+", default=["*"], metavar="PATTERN", help="such as 'Linen_F250_V*'")
    parser.add_argument("--recordings", nargs="+", default=["*"], metavar="PATTERN")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--kidnap", action="store_true", help="put the hand down elsewhere after 80 mm")
    parser.add_argument(
        "--drift", type=float, default=0.0, metavar="W", help="drift of W noise widths per 100 mm"
    )
    parser.add_argument(
        "--noisy-channel",
        type=float,
        nargs="?",
        const=5.0,
        default=0.0,
        metavar="W",
        help="white noise of W (5) noise widths on one of the sixteen channels",
    )
    given = parser.parse_args()
    on_map, recorded = _matching(given.maps), _matching(given.recordings)
    kinds = [kind for kind in given.kinds if not given.kidnap or kind in ("own", "speed")]
    pairs = [
        pair
        for pair in find_pairs(find_conditions(given.folder))
        if on_map(pair.map) and recorded(pair.recording) and pair.kind in kinds
    ]
    if not pairs:
        parser.error("expected a map and a recording, found none that match")
    perturbation = Perturbation(given.drift, given.noisy_channel)
    by_map: dict[Condition, list[Pair]] = {}
    for pair in pairs:
        by_map.setdefault(pair.map, []).append(pair)
    common = named_configuration(given.configuration), perturbation, given.starts, given.kidnap
    calls = [(mapped, own, *common) for mapped, own in by_map.items()]
    show(measured(measure_map, calls, given, _order, totals))


if __name__ == "__main__":
    main()
