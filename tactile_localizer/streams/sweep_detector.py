"""Detection of sweeps in the palm's motion: a sweep ends where the hand reverses or rests."""

from collections.abc import Iterable
from itertools import starmap

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.runs import NANOSECONDS

NO_SWEEP = -1
"""In place of the number of a sweep."""

DEFAULT_REVERSAL_M = 0.002
"""Travel against a sweep's direction that ends it, and travel from rest that begins one, m."""

DEFAULT_REST_S = 2.0
"""Time without that much travel after which the hand is at rest, s."""


class SweepDetector:
    """Assigns a sweep number to each sample as it arrives.

    A reversal is detected once the hand has gone back by ``reversal_m``, so the first samples of a stroke are
    assigned to the sweep before it. A step sideways neither ends nor begins a sweep.

    Parameters
    ----------
    axes : the d axes; travel is measured in x and y, or in yaw if there is no other axis
    one_way : whether strokes against the direction of the first one are ignored, as returns of the hand
    reversal_m : travel that makes a reversal, m (yaw: rad)
    rest_s : time without that much travel after which the hand is at rest, s
    """

    def __init__(
        self,
        axes: tuple[Axis, ...],
        *,
        one_way: bool = False,
        reversal_m: float = DEFAULT_REVERSAL_M,
        rest_s: float = DEFAULT_REST_S,
    ) -> None:
        plane = [column for column, axis in enumerate(axes) if axis.name != "yaw"]
        self._columns = plane or [0]
        self._one_way = one_way
        self._reversal = reversal_m
        self._rest_ns = round(rest_s * NANOSECONDS)
        self._sweeps = 0
        self._part: object = None
        self._forget()

    def _forget(self) -> None:
        # A place on one or two axes is a complex number, which Python handles sooner than small arrays.
        self._first_direction: complex | None = None
        self._direction: complex | None = None
        self._is_sweep = False
        self._furthest = self._mark = 0j
        self._mark_ns: int | None = None

    def update(self, stamp_ns: int, position: np.ndarray, part: object = None) -> int:
        """Number of the sweep of the next sample, from 1; :data:`NO_SWEEP` if it belongs to none.

        Parameters
        ----------
        stamp_ns : stamp of the sample, ns
        position : (d,) palm position, m (yaw: rad); NaN: the sample is in the sweep of the one before
        part : of the recording; a sweep does not go on in another one, as after a jump in time
        """
        return self._update(stamp_ns, complex(*position[self._columns]), part)

    def update_all(self, stamp_ns: np.ndarray, position: np.ndarray, parts: Iterable[object]) -> np.ndarray:
        """Numbers (n,) of the sweeps of the next samples, as :meth:`update` gives them one by one.

        Parameters
        ----------
        stamp_ns : (n,) stamps, ns
        position : (n, d) palm positions
        parts : of the n samples
        """
        place = np.zeros(len(position), complex)
        for part, column in zip((place.real, place.imag), self._columns, strict=False):
            part[:] = position[:, column]
        each = zip(stamp_ns.tolist(), place.tolist(), parts, strict=False)
        return np.fromiter(starmap(self._update, each), int, len(position))

    def _update(self, stamp_ns: int, place: complex, part: object) -> int:
        if part != self._part:
            self._part = part
            self._forget()
        if place == place:  # a number
            self._move(stamp_ns, place)
        return self._sweeps if self._is_sweep else NO_SWEEP

    def _move(self, stamp_ns: int, place: complex) -> None:
        if self._mark_ns is None:
            self._rest_at(stamp_ns, place)
        elif self._direction is None:
            if abs(place - self._mark) >= self._reversal:
                self._begin(stamp_ns, place, since=self._mark)
            elif stamp_ns - self._mark_ns > self._rest_ns:
                self._rest_at(stamp_ns, place)
        else:
            self._advance(stamp_ns, place, self._direction, self._mark_ns)

    def _advance(self, stamp_ns: int, place: complex, direction: complex, mark_ns: int) -> None:
        gain = _along(place - self._furthest, direction)
        if gain > 0:
            self._furthest = place
        if gain < -self._reversal:
            self._begin(stamp_ns, place, since=self._furthest)
        elif _along(place - self._mark, direction) >= self._reversal:
            self._mark, self._mark_ns = place, stamp_ns
        elif stamp_ns - mark_ns > self._rest_ns:
            self._rest_at(stamp_ns, place)

    def _begin(self, stamp_ns: int, place: complex, since: complex) -> None:
        stroke = place - since
        self._direction = stroke / abs(stroke)
        if self._first_direction is None:
            self._first_direction = self._direction
        self._is_sweep = not self._one_way or _along(self._direction, self._first_direction) > 0
        self._sweeps += self._is_sweep
        self._furthest = self._mark = place
        self._mark_ns = stamp_ns

    def _rest_at(self, stamp_ns: int, place: complex) -> None:
        self._direction, self._is_sweep = None, False
        self._mark, self._mark_ns = place, stamp_ns


def _along(travel: complex, direction: complex) -> float:
    return travel.real * direction.real + travel.imag * direction.imag
