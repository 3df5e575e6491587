"""Positions of two sources, positions that are held, and none that change, are described in one line."""

import numpy as np
import pytest

from tactile_localizer.scene import Axis
from tactile_localizer.streams.findings import describe_motion

PLANE = (Axis("x", -1.0, 1.0), Axis("y", -1.0, 1.0), Axis("yaw", -1.0, 1.0))
YAW = PLANE[2:]


def described(seconds, x, axes=PLANE, yaw=0.0, **options):
    stamp_ns = np.round(np.asarray(seconds) * 1e9).astype(np.int64) + 1_764_000_000 * 10**9
    values = {"x": x, "y": 0.0, "yaw": yaw}
    position = np.column_stack([np.broadcast_to(values[axis.name], len(seconds)) for axis in axes])
    return describe_motion(axes, stamp_ns, position, **options)


def strokes(seconds):
    """x of strokes of 40 mm at up to 120 mm/s."""
    return 0.02 * np.sin(6.0 * seconds)


@pytest.mark.parametrize("lag_s", [0.001, 0.003, 0.005])
@pytest.mark.parametrize("axes", [PLANE, YAW])
@pytest.mark.parametrize(("x", "yaw", "size"), [(0.02, 0.0, "20 mm"), (0.0, 0.2, "0.2 rad")])
def test_two_sources_are_described_by_their_distance(lag_s, axes, x, yaw, size):
    seconds = np.sort(np.concatenate([np.arange(0, 5, 0.01), np.arange(lag_s, 5, 0.01)]))
    second = np.abs(seconds / 0.01 - np.round(seconds / 0.01)) > 1e-6
    turned = np.remainder(3.0 + strokes(seconds) + yaw * second + np.pi, 2.0 * np.pi) - np.pi
    text = described(seconds, strokes(seconds) + x * second, axes, turned)
    jumps = f"the position jumps by {size} within {1e3 * lag_s:.2g} ms and back: two sources, or noise"
    assert text == (jumps if yaw or axes is PLANE else "")


@pytest.mark.parametrize("period_s", [0.002, 0.005, 0.01])
@pytest.mark.parametrize("held_s", [0.04, 0.1])
def test_a_slow_source_is_described_by_its_period(period_s, held_s):
    seconds = np.arange(0, 6, period_s)
    resting = np.clip(seconds - 2.0, 0.0, 3.0)  # before and after the motion
    text = described(seconds, 0.05 * np.floor(resting / held_s + 1e-9) * held_s)
    assert text == f"the position is held for {1e3 * held_s:.0f} ms, then steps by {50 * held_s:.2g} mm: " + (
        "a slow source"
    )


def test_a_position_that_does_not_change_is_described_unless_the_palm_may_rest():
    seconds = np.arange(0, 5, 0.01)
    still = np.full(500, 0.03)
    assert described(seconds, still) == "the position does not change over 5.0 s"
    assert described(seconds, still, moves=False) == ""
    assert described(seconds[:50], still[:50]) == ""


RNG = np.random.default_rng(0)
EVEN, UNEVEN = np.arange(0, 5, 0.005), np.sort(RNG.uniform(0, 5, 800))
ORDINARY = {
    "strokes": (EVEN, strokes(EVEN)),
    "uneven stamps": (UNEVEN, strokes(UNEVEN)),
    "noise of 0.3 mm": (EVEN, strokes(EVEN) + RNG.normal(0, 3e-4, 1000)),
    "resolution of 1 mm": (EVEN, np.round(strokes(EVEN), 3)),
    "resolution of 0.1 mm, slow": (EVEN, np.round(0.002 * EVEN, 4)),
    "at rest, then in motion": (EVEN, 0.05 * np.clip(EVEN - 2, 0, 1)),
    "stepwise, with a stop at each place": (
        EVEN, np.interp(EVEN, np.arange(0, 5.3, 0.05), 0.001 * np.repeat(np.arange(22), 5)[:106])),
    "reversals": (EVEN, 0.02 * np.abs((3 * EVEN) % 2 - 1)),
    "5 Hz": (EVEN[::40], strokes(EVEN[::40])),
    "one outlier": (EVEN, strokes(EVEN) + 0.02 * (np.arange(1000) == 500)),
    "put down elsewhere": (EVEN, strokes(EVEN) + 0.05 * (EVEN > 2.5)),
    "none": (EVEN[:0], EVEN[:0]),
}  # fmt: skip


@pytest.mark.parametrize("name", ORDINARY)
def test_ordinary_motion_is_not_described(name):
    assert described(*ORDINARY[name]) == ""


def test_a_few_wrong_positions_are_no_second_source():
    seconds = np.arange(0, 10, 0.01)
    x = strokes(seconds)
    x[100::170] += 0.02
    assert described(seconds, x) == ""
    x[::15] += 0.02
    assert "two sources" in described(seconds, x)
