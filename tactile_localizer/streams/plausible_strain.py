"""Plausibility of strain: values that are none, jumps, values that are held, another gain, other poses.

Each is in a map without a trace, as its status is OK. The thresholds are judgement. In our recordings of load
cells and taxels, real and simulated, an end of the range comes up to 4 times, one step exceeds half of the
range, no strain is held, and no sweep has more than 1.0 times the noise of the others in all channels.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from tactile_localizer.errors import listed
from tactile_localizer.streams.delay import Track
from tactile_localizer.streams.runs import NANOSECONDS

_MIN_COUNT = 50
"""Number of samples below which nothing is reported."""
_END_COUNT, _END_RATIO, _FINE = 10, 10, 2
"""Number of samples with the value at an end of the range, and by that of the value next to it; number of
samples with one value from which values repeat."""
_JUMP, _JUMPS = 0.5, 5
"""Step that is a jump, by the range of a channel; number of them, which is four times that of steps of half
this size: vibration that is sampled slowly has steps of any size."""
_LASTING, _CHANGING = 0.05, 0.01
"""Fraction of the samples for which a channel stops; fraction of the other steps that are zero."""
_HELD, _REGULAR = 2, 0.9
"""Median number of samples from one change of the strain to the next where it is held, and fraction of them
that differ from it by up to one."""
_GAIN = 4.0
"""A sweep is reported whose noise, in every channel, is more than so many times that of the median sweep."""
_BLOCK_S, _BLOCKS, _AT_REST, _AS_MUCH, _ABOVE_NOISE = 0.2, 10, 0.05, 0.5, 2.0
"""Time in which changes are compared, s; number of those at rest and in motion; motion at rest, and change of
the strain at rest, both by those in motion; change in motion by that which white noise has."""


def describe_strain(tracks: Sequence[Track], channels: Sequence[str]) -> list[str]:
    """What is implausible about strain, one line for each kind.

    Parameters
    ----------
    tracks : sweeps; samples that are not finite are left out
    channels : (C,) their names
    """
    tracks = [each for each in map(_finite, tracks) if len(each.stamp_ns) > 2]
    if sum(len(each.stamp_ns) for each in tracks) < _MIN_COUNT:
        return []
    is_step, changes = _are_steps(tracks), np.zeros(sum(len(each.stamp_ns) for each in tracks) - 1, bool)
    spread, noise = np.zeros((2, len(channels)))
    lower, upper, jumps, stops = (list[str]() for _ in range(4))
    # A channel at a time: all at once are as much memory as all that an import needs else.
    for number, name in enumerate(channels):
        column = np.concatenate([each.strain[:, number] for each in tracks])
        every = np.diff(column)
        changes |= every != 0.0
        step = every[is_step]
        for ends, text in zip((lower, upper), _ends(column), strict=True):
            ends += [f"{name}: {text}"] * bool(text)
        jumps += [f"{name} {count} times" for count in filter(None, [_jumps(step, float(np.ptp(column)))])]
        stops += [f"{name} for {count} samples" for count in filter(None, [_stops(column)])]
        spread[number], noise[number] = np.std(column), np.std(step)
    found = [
        (lower + upper, "strain at the end of its range comes again and again, saturated, or no measurement"),
        (jumps, "strain jumps over half of its range within a sample, two sources, spikes, or an overflow"),
        (stops, "strain does not change, a sensor that stopped"),
    ]
    lines = [f"{what}: {listed(names)}" for names, what in found if names]
    return [*lines, *filter(None, [_held(changes[is_step]), _gains(tracks), _at_rest(tracks, spread, noise)])]


def _finite(track: Track) -> Track:
    """The samples that are finite."""
    rows = np.isfinite(track.strain).all(axis=1)
    return track if rows.all() else Track(track.stamp_ns[rows], track.position[rows], track.strain[rows])


def _are_steps(tracks: Sequence[Track]) -> np.ndarray:
    """Which of the differences (n - 1,) of successive samples of all tracks are within one, across no gap."""
    found = []
    for track in tracks:
        period_ns = np.diff(track.stamp_ns)
        found += [period_ns <= 3 * np.median(period_ns), [False]]
    return np.concatenate(found[:-1])


def _ends(column: np.ndarray) -> Iterator[str]:
    """The lower and the upper end of a range, of values (n,), if it comes again and again; else empty.

    Where values repeat, as in steps of a converter, the end nearer to the median is that of rest. So is zero.
    """
    ends = float(column.min()), float(column.max())
    for value, opposite in (ends, ends[::-1]):
        count = np.count_nonzero(column == value)
        if count < _END_COUNT or value == 0.0 or not len(others := column[column != value]):
            yield ""
            continue
        beside = np.count_nonzero(others == others[np.argmin(np.abs(others - value))])
        is_fine = len(np.unique(others)) * _FINE > len(others)
        is_far = np.abs(value - np.median(column)) >= np.abs(opposite - np.median(column))
        is_end = count >= _END_RATIO * beside and (is_fine or is_far)
        yield f"{value:.6g} in {count} of {len(column)} samples" if is_end else ""


def _jumps(step: np.ndarray, spread: float) -> int:
    """Number of steps (m,) that are jumps in a range."""
    jumps, half = (int(np.count_nonzero(np.abs(step) > part * spread)) for part in (_JUMP, _JUMP / 2))
    return jumps if jumps >= _JUMPS and jumps >= 4 * (half - jumps) else 0


def _stops(column: np.ndarray) -> int:
    """Number of samples (n,) for which a channel that changes from sample to sample stops."""
    changes = np.flatnonzero(np.diff(column))
    runs = np.diff(changes, prepend=-1, append=len(column) - 1)
    longest, zeros = int(runs.max()), len(column) - 1 - len(changes)
    value = column[changes[runs.argmax() - 1] + 1] if runs.argmax() else column[0]
    is_long = max(_MIN_COUNT, _LASTING * len(column)) < longest < len(column)
    is_at_end = value in (column.min(), column.max())
    return longest if is_long and not is_at_end and zeros - (longest - 1) < _CHANGING * len(column) else 0


def _held(changes: np.ndarray) -> str:
    """Strain that is held and then steps (m,) bool, as of a source that is slower than its stamps."""
    lasting = np.diff(np.flatnonzero(changes))
    if len(lasting) < _MIN_COUNT or (samples := int(np.median(lasting))) < _HELD:
        return ""
    if np.mean(np.abs(lasting - samples) <= 1) < _REGULAR:
        return ""
    return f"strain is held for {samples} samples, then steps: a source that is slower than its stamps"


def _gains(tracks: Sequence[Track]) -> str:
    """Sweeps in which each channel has the noise of the others times a factor."""
    noise = np.array([np.std(np.diff(each.strain, 2, axis=0), axis=0) for each in tracks])
    usual = np.median(noise, axis=0)
    ratio = np.min(noise / np.where(usual > 0.0, usual, np.inf), axis=1)
    other = np.flatnonzero(ratio > _GAIN)
    if not len(other):
        return ""
    sweeps = f"{len(other)} of {len(tracks)} sweeps"
    factor = np.median(ratio[other])
    return f"strain of {sweeps} has {factor:.2g} times the noise of the others: another unit, or gain"


def _at_rest(tracks: Sequence[Track], spread: np.ndarray, noise: np.ndarray) -> str:
    """Strain that changes while the palm rests, as with poses of another time or that are not sent on.

    ``spread`` and ``noise`` (C,) are the standard deviations of the strain and of its steps.
    """
    spread = np.where(spread > 0.0, spread, np.inf)
    moved, changed, sizes = [], [], []
    for track in tracks:
        block = (track.stamp_ns - track.stamp_ns[0]) // round(_BLOCK_S * NANOSECONDS)
        begin = np.flatnonzero(np.diff(block, prepend=-1))
        size = np.diff([*begin, len(block)])[:, None]
        place, mean = (np.add.reduceat(each, begin) / size for each in (track.position, track.strain))
        moved.append(np.linalg.norm(np.diff(place, axis=0), axis=1))
        changed.append(np.linalg.norm(np.diff(mean, axis=0) / spread, axis=1))
        sizes.append(size)
    motion, change, size = map(np.concatenate, (moved, changed, sizes))
    rests = motion < _AT_REST * np.quantile(motion, 0.9) if len(motion) else np.zeros(0, bool)
    if min(np.count_nonzero(rests), np.count_nonzero(~rests)) < _BLOCKS:
        return ""
    in_motion = np.mean(change[~rests])
    of_noise = np.linalg.norm(noise / spread) / np.sqrt(np.median(size))
    if in_motion < _ABOVE_NOISE * of_noise or np.mean(change[rests]) < _AS_MUCH * in_motion:
        return ""
    return (
        "strain changes while the palm rests as while it moves: poses of another time, or that stopped, or "
        "the grip changed"
    )
