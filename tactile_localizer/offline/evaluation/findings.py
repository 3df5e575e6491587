"""The paper's qualitative findings, each checked on the results: held, not held, or open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_localizer.offline.evaluation.comparison import Results, as_array
from tactile_localizer.offline.evaluation.confidence_interval import Interval, mean_interval
from tactile_localizer.offline.evaluation.methods import exact_form, paper_form

TENTH_INCH = 0.00254
"""m, the paper's mean error on contact."""

HELD, NOT_HELD, OPEN = "held", "not held", "open"

_ALIKE = 0.25
"""Share of the error up to which two methods count as alike."""

_DETECTED = 0.95
"""Share of the sweeps over a feature in which a likelihood has to be reached to count as high."""


@dataclass(frozen=True)
class Finding:
    """A statement of the paper, checked on the results.

    ``verdict`` is :data:`HELD`, :data:`NOT_HELD`, or :data:`OPEN` where the confidence interval allows both.
    """

    statement: str
    source: str
    verdict: str
    numbers: str


def check_findings(results: Results) -> list[Finding]:
    """Every finding that the methods in the results allow to check."""
    checks: list[tuple[Callable[[Results], Finding], tuple[str, ...]]] = [
        (_within_a_tenth_of_an_inch, ("default",)),
        (_gaussians_alike_before_contact, (GAUSSIAN, INDEPENDENT)),
        (_zero_covariance_is_better, (GAUSSIAN, INDEPENDENT)),
        (_gaussian_error_grows_past_the_edge, (GAUSSIAN,)),
        (_sum_alike_at_first_contact, (SUM, GAUSSIAN)),
        (_sum_better_past_the_edge, (SUM, GAUSSIAN)),
        (_plain_criteria_fire_falsely, (GAUSSIAN, INDEPENDENT, SUM)),
        (_featureless_no_worse, (SUM, FEATURELESS)),
        (_featureless_broader_before_contact, (SUM, FEATURELESS)),
        (_featureless_broader_before_contact_exactly, (SUM_EXACT, FEATURELESS_EXACT)),
        (_probability_does_not_fire_falsely, ("default",)),
        (_motion_alone_past_the_feature, ("default",)),
        (_injection_forgets_past_the_feature, (SUM,)),
    ]
    have = set(results.methods)
    return [check(results) for check, needs in checks if have.issuperset(needs)]


SUM, FEATURELESS = paper_form("sum_of_gaussians"), paper_form("featureless")
SUM_EXACT, FEATURELESS_EXACT = exact_form("sum_of_gaussians"), exact_form("featureless")
GAUSSIAN, INDEPENDENT = paper_form("gaussian"), paper_form("gaussian_independent")


@dataclass(frozen=True)
class FalseAlarms:
    """How often a criterion fires before it may.

    Parameters
    ----------
    threshold : m2 of the trace, nats of the likelihood; NaN: built in
    before : share of the sweeps over a feature in which it fires before contact
    blank : share of the sweeps that never reach a feature in which it fires; NaN without such sweeps
    """

    threshold: float
    before: float
    blank: float


def plain_criteria(results: Results, method: str) -> dict[str, FalseAlarms]:
    """The paper's plain criteria (III-D): low trace alone, and high marginal likelihood alone.

    The trace has to fall to what convergence asks for; the likelihood to rise to what it reaches after
    contact in 95 % of the sweeps.
    """
    narrow = float(results.tasks[method][0]["narrow_trace_m2"])
    reached = results.values(method, "highest_marginal_contact")
    likely = float(np.nanquantile(reached, 1.0 - _DETECTED)) if np.isfinite(reached).any() else np.inf
    traces = [results.values(method, "lowest_trace_before_m2"), _of_blanks(results, method, "lowest_trace")]
    heights = [
        results.values(method, "highest_marginal_before"),
        _of_blanks(results, method, "highest_marginal"),
    ]
    return {
        "low trace": FalseAlarms(narrow, *(_share(trace <= narrow) for trace in traces)),
        "high likelihood": FalseAlarms(likely, *(_share(height >= likely) for height in heights)),
    }


def _of_blanks(results: Results, method: str, name: str) -> np.ndarray:
    ending = "_m2" if name == "lowest_trace" else ""
    return as_array([blank[f"{name}_blank{ending}"] for blank in results.blanks(method)])


def own_criterion(results: Results, method: str) -> FalseAlarms:
    """False alarms of the package's own criterion: a probability, held over a distance."""
    before = results.values(method, "converged_before")
    return FalseAlarms(np.nan, _share(before), _share([b["converged"] for b in results.blanks(method)]))


def _share(flags: object) -> float:
    array = np.asarray(flags, dtype=float)
    return float(array.mean()) if len(array) else float("nan")


def _within_a_tenth_of_an_inch(results: Results) -> Finding:
    return _greater(
        "The feature is localised to within one tenth of an inch on contact.",
        "Abstract",
        TENTH_INCH - results.values("default", "error_contact_m"),
        "2.54 mm less the mean error from contact to the feature's end, default",
    )


def _gaussians_alike_before_contact(results: Results) -> Finding:
    return _alike(
        "Before contact, both Gaussian models perform about equally well.",
        "III-B, Fig. 5",
        results.values(INDEPENDENT, "error_before_m"),
        results.values(GAUSSIAN, "error_before_m"),
        "error before contact, no covariance between fingers less full covariance",
    )


def _zero_covariance_is_better(results: Results) -> Finding:
    return _greater(
        "After contact there is a small advantage to no covariance between the fingers.",
        "III-B, Fig. 5",
        results.values(GAUSSIAN, "error_contact_m") - results.values(INDEPENDENT, "error_contact_m"),
        "error after contact, full covariance less none between fingers",
    )


def _gaussian_error_grows_past_the_edge(results: Results) -> Finding:
    curves = _after_contact(results, GAUSSIAN)
    return _greater(
        "The Gaussian model's error grows again once the edge of the feature is passed.",
        "III-B, Fig. 5",
        _mean_of_known(curves[:, 6:8]) - curves[:, 2],
        "error 15 to 20 mm after contact less that 5 to 7.5 mm after",
    )


def _sum_alike_at_first_contact(results: Results) -> Finding:
    return _alike(
        "Just at contact there is little advantage to the sum of Gaussians.",
        "III-C, Fig. 5",
        _after_contact(results, SUM)[:, 0],
        _after_contact(results, GAUSSIAN)[:, 0],
        "error over the first 2.5 mm after contact, sum of Gaussians less Gaussian",
    )


def _sum_better_past_the_edge(results: Results) -> Finding:
    gaussian, of_sum = (_mean_of_known(_after_contact(results, method)[:, 2:]) for method in (GAUSSIAN, SUM))
    return _greater(
        "After that, the sum of Gaussians localises better than the Gaussian model.",
        "III-C, Fig. 5",
        gaussian - of_sum,
        "error from 5 mm after contact on, Gaussian less sum of Gaussians",
    )


def _plain_criteria_fire_falsely(results: Results) -> Finding:
    worst: dict[str, float] = {}
    shares = []
    for method in (GAUSSIAN, INDEPENDENT, SUM):
        for name, alarms in plain_criteria(results, method).items():
            share = float(np.nanmax([alarms.before, alarms.blank]))
            worst[name] = max(worst.get(name, 0.0), share)
            shares.append(f"{name}, {method}: {share:.0%}")
    return Finding(
        "Low covariance alone or high likelihood alone falsely signal convergence before contact.",
        "III-D",
        HELD if min(worst.values()) > 0 else NOT_HELD,
        f"sweeps in which it fires before contact, or blank ones: {'; '.join(shares)}",
    )


def _featureless_no_worse(results: Results) -> Finding:
    return _alike(
        "Modelling featureless regions apart leaves the error about the same.",
        "III-D, Fig. 8a",
        results.values(FEATURELESS, "error_contact_m"),
        results.values(SUM, "error_contact_m"),
        "error after contact, featureless less sum of Gaussians",
    )


def _featureless_broader_before_contact(results: Results) -> Finding:
    return _broader(results, FEATURELESS, SUM, "")


def _featureless_broader_before_contact_exactly(results: Results) -> Finding:
    return _broader(results, FEATURELESS_EXACT, SUM_EXACT, " (exact filter, nothing injected)")


def _broader(results: Results, featureless: str, other: str, how: str) -> Finding:
    return _greater(
        f"Modelling featureless regions apart keeps the belief broader before contact{how}.",
        "III-D, Fig. 8b",
        results.values(featureless, "trace_before_m2") - results.values(other, "trace_before_m2"),
        "covariance trace before contact, featureless less sum of Gaussians",
        unit="mm2",
    )


def _probability_does_not_fire_falsely(results: Results) -> Finding:
    alarms = own_criterion(results, "default")
    blanks = len(results.blanks("default"))
    held = blanks > 0 and alarms.blank == 0.0
    in_blanks = f"in {alarms.blank:.1%} of {blanks} blank sweeps and " if blanks else ""
    return Finding(
        "Convergence is recognized without false alarms where no feature is (this package's criterion).",
        "III-D, aim",
        HELD if held else OPEN if not blanks else NOT_HELD,
        f"fires {in_blanks}in {alarms.before:.1%} of sweeps before contact",
    )


def _motion_alone_past_the_feature(results: Results) -> Finding:
    return _greater(
        "Past the feature the error grows no faster than the motion noise (default).",
        "III, motivation",
        _below_motion(results, "default"),
        "what motion alone makes of the error at the feature's end, less the error past it",
    )


def _injection_forgets_past_the_feature(results: Results) -> Finding:
    return _greater(
        "Past the feature constant injection forgets faster than the motion noise (the paper's form).",
        "III-B",
        -_below_motion(results, SUM),
        "the error past the feature, less what motion alone makes of that at its end",
    )


def _below_motion(results: Results, method: str) -> np.ndarray:
    """How much smaller than by motion alone the error is past the feature, one a sweep, m."""
    sweeps = results.sweeps(method)
    error, motion = (
        np.array([as_array(sweep[name]) for sweep in sweeps]) for name in ("error_past_m", "motion_past_m")
    )
    return _mean_of_known(motion - error)


def _after_contact(results: Results, method: str) -> np.ndarray:
    return np.array([as_array(sweep["error_after_contact_m"]) for sweep in results.sweeps(method)])


def _mean_of_known(rows: np.ndarray) -> np.ndarray:
    """Mean of the finite entries of each row; NaN for a row without."""
    known = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.where(known, rows, 0.0).sum(axis=1) / known.sum(axis=1)


def _greater(statement: str, source: str, difference: np.ndarray, what: str, unit: str = "mm") -> Finding:
    interval = mean_interval(difference)
    verdict = (
        OPEN if interval is None else HELD if interval.low > 0 else NOT_HELD if interval.high < 0 else OPEN
    )
    return Finding(statement, source, verdict, f"{what}: {_mm(interval, unit)}")


def _alike(statement: str, source: str, first: np.ndarray, second: np.ndarray, what: str) -> Finding:
    """Alike when the mean difference is surely within a quarter of the second's mean."""
    interval = mean_interval(first - second)
    if interval is None:
        return Finding(statement, source, OPEN, f"{what}: not known")
    margin = _ALIKE * float(np.nanmean(second))
    if -margin <= interval.low and interval.high <= margin:
        verdict = HELD
    else:
        verdict = NOT_HELD if interval.low > margin or interval.high < -margin else OPEN
    return Finding(
        statement, source, verdict, f"{what}: {_mm(interval)}; alike is within {margin * 1e3:.2f} mm"
    )


def _mm(interval: Interval | None, unit: str = "mm") -> str:
    if interval is None:
        return "not known"
    scale = 1e6 if unit == "mm2" else 1e3
    mean, low, high = (value * scale for value in interval)
    return f"{mean:+.2f} {unit} (95 %: {low:+.2f} to {high:+.2f})"
