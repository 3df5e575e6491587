"""Measures of the clocks of strain and poses, and of how far poses are apart."""

import numpy as np

from tactile_localizer.streams.arrivals import Measure, Seen
from tactile_localizer.streams.runs import NANOSECONDS

_ZONE_S, _IN_ZONES_S, _MOST_ZONES_S = 900.0, 1.0, 26 * 3600.0
"""Time zones differ by multiples of a quarter of an hour, s; difference from one that is none of a zone, s
(judgement); largest difference of two zones, s."""
_QUANTILES = np.linspace(0.0, 1.0, 101)


def clock_difference_s(stamp_ns: np.ndarray, pose_ns: np.ndarray) -> float:
    """Time by which the clock of the poses is ahead of that of the strain, s; 0.0 where they may be the same.

    They differ where poses and strain do not overlap, or both begin and end one difference of time zones
    apart. The difference of two zones is exact; another is the median one of equal fractions of both.

    Parameters
    ----------
    stamp_ns, pose_ns : (n,) and (m,) stamps of the strain and of the poses, ns, at least one of each
    """
    begin_ns, end_ns = (stamp_ns.min(), stamp_ns.max())
    ahead_s = (
        np.quantile(pose_ns - begin_ns, _QUANTILES) - np.quantile(stamp_ns - begin_ns, _QUANTILES)
    ) * 1e-9
    zone_s = _ZONE_S * round(float(np.median(ahead_s)) / _ZONE_S)
    is_zone = 0.0 < abs(zone_s) <= _MOST_ZONES_S and bool((abs(ahead_s - zone_s) <= _IN_ZONES_S).all())
    if is_zone:
        return zone_s
    overlaps = pose_ns.max() >= begin_ns and pose_ns.min() <= end_ns
    return 0.0 if overlaps else round(float(np.median(ahead_s)), 3)


def is_of_zones(difference_s: float) -> bool:
    """Whether a difference of two clocks, s, is that of two time zones."""
    return difference_s != 0.0 and not difference_s % _ZONE_S and abs(difference_s) <= _MOST_ZONES_S


def difference(seen: Seen) -> Measure:
    """Time by which the clock of all poses is ahead of that of all strain, s."""
    ahead_s = clock_difference_s(seen.strain_ns, seen.pose_ns)
    what = "time zone" if is_of_zones(ahead_s) else "clock"
    yield ahead_s, {"what": what, "ranges": _ranges(seen)}


def duration(seen: Seen) -> Measure:
    """Duration of the longer of strain and poses by that of the other, 0.0 where they overlap.

    Where they differ by far, no offset of a clock makes one from the other.
    """
    strain_s, pose_s = (float(np.ptp(each)) / NANOSECONDS for each in (seen.strain_ns, seen.pose_ns))
    longer_s, shorter_s = max(strain_s, pose_s), min(strain_s, pose_s)
    is_apart = shorter_s > 0.0 and clock_difference_s(seen.strain_ns, seen.pose_ns) != 0.0
    words = {"strain_s": strain_s, "pose_s": pose_s, "ranges": _ranges(seen)}
    yield longer_s / shorter_s if is_apart else 0.0, words


def outside(seen: Seen) -> Measure:
    """Fraction of the strain that is before or after all poses."""
    before, after = seen.strain_ns < seen.pose_ns.min(), seen.strain_ns > seen.pose_ns.max()
    yield float(np.mean(before | after)), {"ranges": _ranges(seen)}


def spacing(seen: Seen) -> Measure:
    """Median time between two poses, by the longest one across which is interpolated."""
    apart_s = float(np.median(np.abs(np.diff(seen.pose_ns)))) / NANOSECONDS if len(seen.pose_ns) > 1 else 0.0
    words = {"apart_s": apart_s, "most_s": seen.max_gap_s, "option": seen.option, "wider_s": 1.5 * apart_s}
    yield apart_s / max(seen.max_gap_s, 1e-9), words


def lead(seen: Seen) -> Measure:
    """Median time by which the stamps of poses are ahead of those of the strain received with them, s."""
    if seen.lead_s is not None and len(seen.lead_s):
        yield float(np.median(seen.lead_s)), {}


def _ranges(seen: Seen) -> str:
    (begin, end), (first, last) = ((each.min(), each.max()) for each in (seen.strain_ns, seen.pose_ns))
    seconds = (each / NANOSECONDS for each in (begin, end, first, last))
    return "strain from {:.3f} to {:.3f} s, poses from {:.3f} to {:.3f} s".format(*seconds)
