"""The examination of a scan in words."""

import re

import pytest

from tactile_localizer.core.calibration.examination import Examination, Outcome
from tactile_localizer.offline.examination import describe_examination, examination_findings
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("sheet", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.04)), (Phalanx("index", (0.0, 0.0)),))


def examination(off_map: int = 0, wrong: int = 0, along_y: float = -0.1, sweeps: int = 6) -> Examination:
    """Of ``sweeps`` held-out sweeps, ``wrong`` of them wrong, and twelve trials off the map."""

    def outcome(n: int, on_map: bool, false: bool) -> Outcome:
        axes = (-0.1, along_y) if on_map else ()
        right = on_map and not false
        return Outcome(n, on_map, -1.0, right, false, right or false, (0.001, 0.002), (0.001, 0.011), axes)

    tried = [outcome(n, True, n < wrong) for n in range(sweeps)]
    tried += [outcome(n % sweeps, False, n < off_map) for n in range(12)]
    return Examination(0.003, -3.0, (-1.5, -1.2), tuple(tried))


def test_what_to_expect_is_said() -> None:
    found = describe_examination(SCENE, examination(off_map=1, wrong=2))
    assert found == [
        "6 trials of 6 held-out sweeps: 4 right at the end, 2 ever wrong, "
        "0 converged and lost again, 0 never converged",
        "error of those: x 1.00 mm, y 2.00 mm",
        "12 trials on material that is not on the map: 1 ever converged",
        "they are of the force and the session of the scan: to see what another force or day costs, replay "
        "some sweeps that were recorded with another grip",
        "score -1.00 (0: sure and right; -3.00: no better than ignorance), information length 3.0 mm",
    ]
    assert describe_examination(SCENE, Examination()) == []


@pytest.mark.parametrize(
    ("what", "finding"),
    [
        ({"along_y": -1.0}, "y is not known better than 38.1 mm along 40 mm: .* or name x alone"),
        ({"wrong": 2}, "converged at a wrong place in the examination: sweep 1, 2"),
        ({"off_map": 2}, "2 of 12 trials converge on material that is not on the map"),
        ({"sweeps": 2}, "examination: only 2 sweeps, which says little; record more"),
    ],
)
def test_what_needs_attention_is_a_finding(what: dict[str, float], finding: str) -> None:
    (found,) = examination_findings(SCENE, examination(**what))  # type: ignore[arg-type]
    assert re.match(finding, found), found


def test_a_single_false_claim_is_no_finding() -> None:
    assert examination_findings(SCENE, examination(off_map=1)) == []
