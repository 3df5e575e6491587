"""Held-out sweeps, and the maps on which they are localized."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from support.scans import bump_scan
from support.scans import scene as scene_of

from tactile_localizer.core.calibration.sweep_model import SweepModel, learn_sweep_model
from tactile_localizer.core.calibration.trials import Trial, held_out, trials_on_map
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

SHEET = scene_of()


def of_two_sessions(second: slice) -> Scan:
    """A raster, and some of its lines again in another session."""
    one, two = bump_scan(SHEET), bump_scan(SHEET, seed=1)
    again = two.select(np.isin(two.sweep, two.sweep_numbers[second]))
    first = int(one.sweep.max()) + 1
    return replace(
        one,
        states=np.concatenate([one.states, again.states]),
        strain=np.concatenate([one.strain, again.strain]),
        sweep=np.concatenate([one.sweep, again.sweep + first]),
        sessions=(0, first + int(again.sweep.min())),
    )


@pytest.mark.parametrize("second", [slice(None), slice(2, 5)], ids=["all lines again", "three lines again"])
def test_a_sweep_is_localized_without_its_session_where_another_lies_on_its_way(second: slice) -> None:
    scan = of_two_sessions(second)
    of_second = scan.sweep_numbers[scan.sweep_numbers >= scan.sessions[1]]
    model = learn_sweep_model(scan, SHEET, Material.SHEET)

    def build(_: SweepModel, without: Sequence[np.ndarray], __: Scene) -> list[np.ndarray]:
        """In place of localizers the numbers of the sweeps that they know."""
        return [scan.sweep_numbers[~out] for out in without]

    sweeps = held_out(scan, model.scan.tracks, model.scan.spacing)
    for trial in trials_on_map(48, model, build, sweeps):  # type: ignore[arg-type]
        known, own = trial.localizer, trial.sweep.number
        assert own not in known  # type: ignore[operator]
        is_of_second = own in of_second
        assert trial.other_session or not is_of_second
        if trial.other_session:
            is_known = np.isin(of_second, known)  # type: ignore[arg-type]
            assert is_known.all() != is_of_second
            assert is_known.any() != is_of_second
    assert any(each.session is not None for each in sweeps)
    assert all(each.session is not None for each in sweeps) == (second == slice(None))


def test_each_of_few_sweeps_is_localized_from_its_start_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be the same again; from further on there is another begin each time."""
    scan = bump_scan(SHEET)
    model = learn_sweep_model(scan, SHEET, Material.SHEET)
    sweeps = held_out(scan, model.scan.tracks, model.scan.spacing)[:3]
    begins = {tuple(each.positions[0]) for each in sweeps}
    made = Counter[tuple[tuple[float, ...], float]]()
    monkeypatch.setattr(
        Trial, "_localized", lambda trial, length, _: made.update([(tuple(trial.sweep.positions[0]), length)])
    )
    trials = list(trials_on_map(48, model, lambda _, out, __: [None] * len(out), sweeps))  # type: ignore[misc]
    for length in (0.003, 0.005):
        for trial in trials:
            trial.localize(length, length)
    assert len(trials) == 48
    assert sum(tuple(trial.sweep.positions[0]) in begins for trial in trials) == 24
    assert {count for (begin, _), count in made.items() if begin in begins} == {1}
    assert len({begin for begin, _ in made} - begins) > 12
    assert {length for _, length in made} == {0.003, 0.005}


def test_a_fragment_is_held_out_only_where_there_is_nothing_else() -> None:
    """As of return strokes that were not recorded, of which a detector of sweeps keeps the first strains."""
    whole = bump_scan(SHEET)
    odd = whole.sweep_numbers[1::2]
    fragments = np.concatenate([np.flatnonzero(whole.sweep == number)[-5:] for number in odd])
    among_whole = np.concatenate([np.flatnonzero(~np.isin(whole.sweep, odd)), fragments])
    for rows, is_fragment in ((among_whole, False), (fragments, True)):
        scan = whole.select(rows)
        model = learn_sweep_model(scan, SHEET, Material.SHEET)
        held = held_out(scan, model.scan.tracks, model.scan.spacing)
        assert len(held) > 1
        assert {len(each.positions) == 5 for each in held} == {is_fragment}


def test_the_sessions_of_a_scan_are_part_of_what_is_learned() -> None:
    scan = of_two_sessions(slice(None))
    assert digest_of(scan, SHEET) != digest_of(replace(scan, sessions=()), SHEET)
