"""The examination of a scan in words."""

import re
from dataclasses import replace

import pytest

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.offline.examination import describe_examination, examination_findings
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("sheet", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.04)), (Phalanx("index", (0.0, 0.0)),))


def examination(off_map: int = 0, wrong: int = 0, along_y: float = -0.1, sweeps: int = 6) -> Examination:
    """Of ``sweeps`` held-out sweeps, ``wrong`` of them wrong, and 48 trials off the map."""

    def outcome(n: int, on_map: bool, false: bool) -> Outcome:
        axes = (-0.1, along_y) if on_map else ()
        right = on_map and not false
        claimed = float(right or false)
        return Outcome(n, on_map, -1.0, right, false, claimed, claimed, (0.001, 0.002), (0.001, 0.011), axes)

    tried = [outcome(n, True, n < wrong) for n in range(sweeps)]
    tried += [outcome(n % sweeps, False, n < off_map) for n in range(48)]
    return Examination(0.003, 0.005, -3.0, (-1.5, -1.2), tuple(tried))


def test_what_to_expect_is_said() -> None:
    found = describe_examination(SCENE, examination(off_map=1, wrong=2))
    assert found == [
        "6 sweeps, each on a map without it: 4 right at the end, 2 ever wrong, "
        "0 converged and lost again, 0 never converged",
        "mean error of those that are right: x 1.00 mm, y 2.00 mm",
        "48 parts of 6 sweeps, each on a map without its surroundings, as on material that was not scanned: "
        "1 converged, which is wrong",
        "nothing is known of another force or another day: scan some lines again so, in another session",
        "probability of the true place 0.37 on average (a blind guess: 0.05, certainty: 1); "
        "one independent measurement of the position per 3.0 mm of travel, "
        "of whether this is the map per 5.0 mm",
    ]
    assert describe_examination(SCENE, Examination()) == []


def test_what_another_session_costs_is_said() -> None:
    found = examination()
    of_another = replace(found, outcomes=tuple(replace(each, other_session=True) for each in found.outcomes))
    lines = describe_examination(SCENE, of_another)
    assert "6 sweeps of them on a map of other sessions: 6 right at the end" in lines
    assert not any("nothing is known" in line for line in lines)


@pytest.mark.parametrize(
    ("what", "finding"),
    [
        (
            {"along_y": -1.0},
            "y cannot be localized: 38.1 of the 40 mm remain possible .* leave y out of the scene",
        ),
        ({"wrong": 2}, "converged at a wrong place in the examination: sweep 1, 2"),
        ({"off_map": 2}, "2 of 48 parts of 6 sweeps converge on a map without their surroundings"),
        ({"sweeps": 2}, "examination: only 2 sweeps, which says little; record more"),
    ],
)
def test_what_needs_attention_is_a_finding(what: dict[str, float], finding: str) -> None:
    (found,) = examination_findings(SCENE, examination(**what))  # type: ignore[arg-type]
    assert re.match(finding, found), found


@pytest.mark.parametrize(
    ("along_y", "alike", "why"),
    [
        (-0.1, (), "the sweeps differ from each other by as much as places do"),
        (-0.1, (0.0, 0.04), "places that are x 0.00 mm, y 40.00 mm apart feel alike, until .*"),
        (-1.0, (), "the position along y stays open"),
    ],
)
def test_why_few_sweeps_converge_is_said(along_y: float, alike: tuple[float, ...], why: str) -> None:
    found = examination(along_y=along_y)
    never = [
        replace(each, right=False, claimed=0.0, alike=alike) if each.on_map and each.sweep < 4 else each
        for each in found.outcomes
    ]
    *_, last = examination_findings(SCENE, replace(found, outcomes=tuple(never)))
    assert re.fullmatch(f"only 2 of 6 sweeps converged: {why}", last), last


@pytest.mark.parametrize(
    ("places", "behind"),
    [
        ([(0.02, 0.0), (0.021, 0.04), (0.022, 0.0), (0.049, 0.04)], "half of them behind x 21 to 29 mm"),
        ([(0.0, 0.0), (0.05, 0.04), (0.0, 0.04), (0.05, 0.0)], "all over the scan"),
    ],
)
def test_where_sweeps_are_lost_again_is_said(places: list[tuple[float, ...]], behind: str) -> None:
    found = examination()
    lost = [
        replace(each, right=False, last_known=places[each.sweep])
        if each.on_map and each.sweep < len(places)
        else each
        for each in found.outcomes
    ]
    (line,) = examination_findings(SCENE, replace(found, outcomes=tuple(lost)))
    assert line == f"4 of 6 sweeps are lost again, {behind}"


def test_a_single_false_claim_is_no_finding() -> None:
    assert examination_findings(SCENE, examination(off_map=1)) == []
