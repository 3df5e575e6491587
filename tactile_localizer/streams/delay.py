"""Delay of the strain against the palm poses, from strokes in opposite directions.

Strain that is late by a time is paired with positions that the palm reached later, so strokes in opposite
directions are displaced against each other by twice the speed times the delay. The delay is that for which
neighbouring strokes agree best. Strokes in one direction hide it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise, repeat

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import NANOSECONDS
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector

MOST_DELAY_S = 1.0
"""Longest delay that can be given, s."""
_LONGEST_S = 0.5
"""Longest delay that is looked for, s."""
_CELLS = 128
"""Number of cells of a stroke in which it is compared with others: of 0.4 mm on 50 mm."""
_MIN_CELLS = 24
"""Number of cells that two strokes have in common from which they are compared."""
_MOST = 0.7
"""Displacement of two strokes, by their length, beyond which too little is left to compare."""
_MIN_PAIRS = 3
"""Number of pairs of opposite strokes from which a delay can be told from chance."""
_SLANTS = np.linspace(-1.0, 1.0, 21)
"""Displacements of what is felt from stroke to stroke, by their distance: up to 45 degrees across them."""
_REFINEMENTS = 3
"""Number of estimates, each of what the one before left."""
_SHORTEST_S = 0.01
"""Shortest delay that is corrected, s (judgement): it displaces a map by .2 mm at 20 mm/s."""
_CHANCE = 0.005
"""Probability with which a delay is found where there is none."""


@dataclass(frozen=True)
class Track:
    """Samples in the order of their stamps, such as those of a sweep.

    Parameters
    ----------
    stamp_ns : (n,) rising stamps, ns
    position : (n, d) palm positions, m (yaw: rad)
    strain : (n, C) strain; not finite where missing
    """

    stamp_ns: np.ndarray
    position: np.ndarray
    strain: np.ndarray


@dataclass(frozen=True)
class Delay:
    """Time by which strain is late.

    Parameters
    ----------
    seconds : time by which the strain is behind the poses, s; negative: ahead of them
    error_s : half of the interval in which it is with 95 %, s
    displacement : of strokes in opposite directions against each other, m (yaw: rad)
    is_significant : whether it is more than chance
    """

    seconds: float
    error_s: float
    displacement: float
    is_significant: bool

    @property
    def is_likely(self) -> bool:
        """Whether there is one with 95 %, significant or not."""
        return abs(self.seconds) > max(_SHORTEST_S, self.error_s)

    def __str__(self) -> str:
        """The delay with its interval, and what it does, in one line."""
        found = f"{self.seconds:.3f} s (+-{self.error_s:.3f} s)"
        if not self.is_significant:
            seen = (
                "may be late against the poses, or of a clock that drifts"
                if self.is_likely
                else "is not late"
            )
            return f"strain {seen}: {found}"
        strokes = f"strokes in opposite directions are displaced by {1e3 * self.displacement:.2g} mm"
        return f"strain is late against the poses by {found}: {strokes}"


HIDDEN = (
    "a delay of the strain against the poses cannot be seen: no strokes in opposite directions side by side"
)
"""Where there is no estimate."""


@dataclass(frozen=True)
class _Stroke:
    """Motion in one direction.

    Parameters
    ----------
    time_s : (n,) times of the samples, s
    along : (n,) coordinates in the main direction of all strokes, rising or falling, m (yaw: rad)
    strain : (n, C) strain by the spread of its channel, smoothed
    across : coordinate across the main direction, m
    """

    time_s: np.ndarray
    along: np.ndarray
    strain: np.ndarray
    across: float

    @property
    def velocity(self) -> float:
        """Mean velocity in the main direction."""
        return float((self.along[-1] - self.along[0]) / (self.time_s[-1] - self.time_s[0]))

    def profile(self, places: np.ndarray, delay_s: float) -> np.ndarray:
        """Strain (m, C) at coordinates (m,) if it is late by a time, s; NaN where the stroke was not."""
        felt_s = self.time_s - delay_s
        known = (felt_s >= self.time_s[0]) & (felt_s <= self.time_s[-1])
        along, strain = np.interp(felt_s[known], self.time_s, self.along), self.strain[known]
        if self.velocity < 0.0:
            along, strain = along[::-1], strain[::-1]
        inside = (
            (places >= along[0]) & (places <= along[-1]) if len(along) > 1 else np.zeros(len(places), bool)
        )
        found = np.full((len(places), strain.shape[1]), np.nan)
        after = np.searchsorted(along, places[inside]).clip(1)
        step = along[after] - along[after - 1]
        part = (places[inside] - along[after - 1]) / np.where(step > 0.0, step, 1.0)
        found[inside] = strain[after - 1] + part[:, None] * (strain[after] - strain[after - 1])
        return found


def estimate_delay(axes: tuple[Axis, ...], tracks: Sequence[Track]) -> Delay | None:
    """How late the strain is; ``None`` if there are no strokes in opposite directions beside each other.

    Parameters
    ----------
    axes : the d axes
    tracks : samples in which the positions are those at the stamps of the strain
    """
    strokes = sorted(_strokes(axes, tracks) if tracks else [], key=lambda stroke: stroke.across)
    pairs = [(one, other) for one, other in pairwise(strokes) if one.velocity * other.velocity < 0.0]
    if len(pairs) < _MIN_PAIRS:
        return None
    from scipy.special import stdtrit

    low, high = (end(end(each.along) for each in strokes) for end in (min, max))
    length = float(np.median([np.ptp(each.along) for each in strokes]))
    places = np.arange(low, high, length / _CELLS)
    closing = np.array([one.velocity - other.velocity for one, other in pairs])  # displacement by delay
    apart = np.array([other.across - one.across for one, other in pairs])
    seconds, error_s, is_unique = 0.0, 0.0, True
    for number in range(_REFINEMENTS):
        profiles = {id(stroke): stroke.profile(places, seconds) for stroke in strokes}
        misfits = np.array([_misfits(profiles[id(one)], profiles[id(other)]) for one, other in pairs])
        longest_s = min(_LONGEST_S, _MOST * length / float(np.median(np.abs(closing)))) / (1 + 4 * number)
        step_s, error_s, unique = _fit(misfits, closing * _CELLS / length, apart * _CELLS / length, longest_s)
        seconds, is_unique = seconds + step_s, is_unique and unique
    quantile = stdtrit(len(pairs) - 1, [0.975, 1.0 - _CHANCE / 2]).tolist()
    return Delay(
        seconds,
        error_s * quantile[0],
        float(np.median(np.abs(closing))) * abs(seconds),
        is_unique and abs(seconds) > max(_SHORTEST_S, error_s * quantile[1]),
    )


def _fit(
    misfits: np.ndarray, closing: np.ndarray, apart: np.ndarray, longest_s: float
) -> tuple[float, float, bool]:
    """The delay for which strokes agree best, its standard error, s, and whether no other fits as well.

    Parameters
    ----------
    misfits : (p, 2 m + 1) of p pairs of strokes at displacements of -m to m cells
    closing : (p,) velocities of the pairs towards each other, cells/s
    apart : (p,) distances across the strokes, cells
    longest_s : longest delay, s
    """
    from scipy.ndimage import minimum_filter1d
    from scipy.special import stdtrit

    step_s = 0.5 / float(np.median(np.abs(closing)))
    number = max(2, round(longest_s / step_s))
    delays_s = step_s * np.arange(-number, number + 1)
    slants = _SLANTS if apart.any() else np.zeros(1)
    most = misfits.shape[1] // 2
    at = slants[:, None, None] * apart[:, None] - closing[:, None] * delays_s + most  # slant, pair, delay
    before = np.floor(at).astype(int).clip(0, 2 * most - 1)
    pair = np.arange(len(misfits))[:, None]
    left, right = misfits[pair, before], misfits[pair, before + 1]
    of_pairs = np.where(np.abs(at - most) <= most, left + (at - before) * (right - left), 1.0)
    best, slant = _lowest(of_pairs.sum(axis=1), delays_s)
    others = [_lowest(of_pairs.sum(axis=1) - of_pairs[:, one], delays_s)[0] for one in range(len(misfits))]
    count = len(misfits)
    error_s = np.sqrt((count - 1) / count * np.sum((np.array(others) - np.mean(others)) ** 2))
    row = int(np.argmin(np.abs(delays_s - best)))
    total = of_pairs[slant].sum(axis=0)
    minima = minimum_filter1d(total, 3) == total
    rivals = np.flatnonzero(minima & (np.abs(np.arange(len(total)) - row) > 1))
    excess = of_pairs[slant][:, rivals] - of_pairs[slant][:, [row]]
    chance = np.std(excess, axis=0, ddof=1) / np.sqrt(count) * stdtrit(count - 1, 0.95)
    is_unique = bool(0 < row < len(total) - 1 and (np.mean(excess, axis=0) > chance).all())
    return best, float(error_s), is_unique


def _lowest(misfit: np.ndarray, delays_s: np.ndarray) -> tuple[float, int]:
    """Delay, s, at the minimum of a misfit by slant and delay, between the delays, and row of its slant."""
    slant, row = np.unravel_index(int(np.argmin(misfit)), misfit.shape)
    if not 0 < row < len(delays_s) - 1:
        return float(delays_s[row]), int(slant)
    before, here, after = misfit[slant, row - 1 : row + 2]
    part = 0.5 * (before - after) / max(before - 2 * here + after, 1e-12)
    return float(delays_s[row] + part * (delays_s[1] - delays_s[0])), int(slant)


def _misfits(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Differences of two profiles (n, C) at displacements of the other by -m to m cells, (2 m + 1,).

    Each is the mean square but for the levels, by that of both; 1 where they have too little in common.
    """
    most = round(_MOST * _CELLS)
    found = np.ones(2 * most + 1)
    has = [np.isfinite(each).all(axis=1) for each in (one, other)]
    for shift in range(-most, most + 1):
        first = slice(max(-shift, 0), len(one) - max(shift, 0))
        second = slice(max(shift, 0), len(one) - max(-shift, 0))
        rows = has[0][first] & has[1][second]
        if np.count_nonzero(rows) >= _MIN_CELLS:
            pair = [each[part][rows] for each, part in ((one, first), (other, second))]
            a, b = (each - each.mean(axis=0) for each in pair)
            found[shift + most] = np.sum((a - b) ** 2) / max(np.sum(a**2) + np.sum(b**2), 1e-30)
    return found


def _strokes(axes: tuple[Axis, ...], tracks: Sequence[Track]) -> list[_Stroke]:
    """Strokes along the direction in which the palm moves most."""
    plane = [column for column, axis in enumerate(axes) if axis.name != "yaw"] or [0]
    places = [track.position[:, plane] for track in tracks]
    steps = np.concatenate([np.diff(each, axis=0) for each in places])
    if not steps.any():
        return []
    directions = np.linalg.svd(steps.T @ steps)[0]
    detector = SweepDetector(axes)
    found = []
    for track, place in zip(tracks, places, strict=True):
        labels = detector.update_all(track.stamp_ns, track.position, repeat(id(track)))
        labels[~np.isfinite(track.strain).all(axis=1)] = NO_SWEEP
        for label in np.unique(labels[labels > 0]).tolist():
            rows = np.flatnonzero(labels == label)
            along = place[rows] @ directions[:, 0]
            begin, end = sorted((int(np.argmin(along)), int(np.argmax(along))))
            rows = rows[begin : end + 1]
            if len(rows) >= _MIN_CELLS:
                found.append((track, place[rows] @ directions, rows))
    if not found:
        return []
    from scipy.ndimage import uniform_filter1d

    parts = [(track.strain, rows) for track, _, rows in found]
    count = sum(len(rows) for _, rows in parts)
    mean = _sum(strain[rows] for strain, rows in parts) / count
    spread = np.sqrt(_sum((strain[rows] - mean) ** 2 for strain, rows in parts) / count)
    strokes = []
    for track, place, rows in found:
        time_s = (track.stamp_ns[rows] - track.stamp_ns[rows[0]]) / NANOSECONDS
        forward = np.sign(place[-1, 0] - place[0, 0])
        along = forward * np.maximum.accumulate(forward * place[:, 0])
        strain = track.strain[rows] / np.where(spread > 0.0, spread, 1.0)
        smooth = uniform_filter1d(strain, 2 * (len(rows) // (2 * _CELLS)) + 1, axis=0)
        strokes.append(_Stroke(time_s, along, smooth, float(place[:, 1:].mean()) if len(plane) > 1 else 0.0))
    return strokes


def _sum(parts: Iterable[np.ndarray]) -> np.ndarray:
    """Sum (C,) of the rows of all parts (n, C), without holding them at once."""
    return reduce(lambda total, part: np.sum(np.vstack([*total, part]), axis=0)[None], parts, [])[0]
