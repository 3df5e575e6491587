"""Which feature is it, what that costs, and what a hand knows that has lost one of two phalanges.

A feature counts as named from 5 mm after contact to its end; each measurement update counts once. A
phalanx that is left knows something only of sweeps on which it comes by the feature: the fingertips lie
25.4 mm apart, and the features are 10 to 12 mm wide. So those sweeps are told apart from the others, and on
the others the error is compared with that of an observer who knows where it would have felt the feature.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/hand.py [--seeds 51 52] [--sweeps 18]``.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from record import record, row

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_identifier, build_localizer
from tactile_localizer.core.identification import NONE, FeatureIdentifier
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim import SimulatedScan, simulate_scan
from tactile_localizer.sim.hand import OFFSETS_M
from tactile_localizer.sim.sweep import FEATURE_CENTER_M

FEATURES = ("bump", "snap", "grommet")
FOREIGN = ("seam", "none")
SURE_M = 0.005
"""Travel after contact from which a feature is to be named."""
COMES_BY_M = 0.014
"""Distance in y from a fingertip's centre to the feature's, up to which it touches it."""

Shares = dict[str, list[bool]]
Errors = dict[str, list[float]]


def candidates(seed: int) -> dict[str, tuple[Any, Any]]:
    """A scan of each feature and its shipped scene."""
    scenes = {name: load_scene(resource_path(f"config/scenes/{name}.yaml")) for name in FEATURES}
    return {name: (simulate_scan(name, seed=seed).to_scan(), scene) for name, scene in scenes.items()}


def name_features(identifier: FeatureIdentifier, seed: int, sweeps: int, shares: Shares) -> None:
    """Sweep over each feature, over a foreign one and over none."""
    for material in FEATURES + FOREIGN:
        test = simulate_scan(material, seed, "test", sweeps=sweeps)
        for number, part in enumerate(test.slices()):
            identifier.reset()
            right = []
            for k in range(part.start, part.stop):
                heard = identifier.update(int(test.stamp_ns[k]), test.odometry[k], test.strain[k])
                estimate = next(iter(heard.estimates.values()))
                if estimate.updated and _counts(test, number, k):
                    right.append(heard.most_probable == (material if material in FEATURES else NONE))
            shares[material] += right
            if material in FEATURES:
                shares["at the end"] += right[-1:]


def _counts(test: SimulatedScan, number: int, k: int) -> bool:
    contact = test.contact[number]
    since = test.truth[k, 0] - test.truth[contact, 0]
    return contact < 0 or (since > SURE_M and k <= test.feature_end[number])


def cost(identifier: FeatureIdentifier, localizers: Sequence[Localizer], seed: int) -> float:
    """Processor time of identifying, over that of the same localizers each by itself."""
    taken = np.zeros(2)
    for feature in FEATURES:
        test = simulate_scan(feature, seed, "test", sweeps=4)
        for part in test.slices():
            for one in (identifier, *localizers):
                one.reset()
            for k in range(part.start, part.stop):
                heard = int(test.stamp_ns[k]), test.odometry[k], test.strain[k]
                begun = time.process_time()
                identifier.update(*heard)
                between = time.process_time()
                for localizer in localizers:
                    localizer.update(*heard)
                taken += between - begun, time.process_time() - between
    return float(taken[0] / taken[1])


def lose_a_phalanx(localizer: Localizer, feature: str, seed: int, sweeps: int, errors: Errors) -> None:
    """With one phalanx left, on all sweeps, on those that it comes by the feature on, and while converged."""
    test = simulate_scan(feature, seed, "test", sweeps=sweeps)
    both, both_converged, updated = _track(localizer, test, np.ones(2, dtype=bool))
    y = np.concatenate([np.full(len(k), test.truth[k, 1].mean()) for k in updated])
    for left in range(2):
        one, converged, _ = _track(localizer, test, np.arange(2) == left)
        comes_by = np.abs(y + OFFSETS_M[left, 1] - FEATURE_CENTER_M[1]) < COMES_BY_M
        knows = np.where(comes_by, both, _of_one_who_felt_nothing(localizer.scene, test, updated, left))
        for kind, of_one, of_both in (
            ("", one, both),
            (" that comes by the feature", one[comes_by], both[comes_by]),
            (" that does not", one[~comes_by], both[~comes_by]),
            (" that does not, as an observer", knows[~comes_by], both[~comes_by]),
            (", as both or as an observer", knows, both),
            (", while converged", one[converged], both[both_converged]),
        ):
            errors["one left" + kind] += of_one.tolist()
            errors["both, for one left" + kind] += of_both.tolist()


def _track(
    localizer: Localizer, test: SimulatedScan, present: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Of the measurement updates on contact: errors, m, whether converged, and which they are."""
    errors, converged, updated = [], [], []
    for number, part in enumerate(test.slices()):
        localizer.reset()
        felt = []
        for k in range(part.start, test.feature_end[number] + 1):
            estimate = localizer.update(int(test.stamp_ns[k]), test.odometry[k], test.strain[k], present)
            if estimate.updated and k >= test.contact[number]:
                errors.append(np.linalg.norm(estimate.mean - test.truth[k]))
                converged.append(estimate.converged)
                felt.append(k)
        updated.append(np.array(felt, dtype=int))
    return np.array(errors), np.array(converged), updated


def _of_one_who_felt_nothing(
    scene: Scene, test: SimulatedScan, updated: list[np.ndarray], left: int
) -> np.ndarray:
    """Errors, m, of an observer who knows only, but exactly, where the feature would have been felt.

    All starts in the scene are alike to it, but those from which the finger that is ``left`` would have come
    by the feature so far.
    """
    axes = [np.linspace(low, high, 48) for low, high in zip(scene.lower, scene.upper, strict=True)]
    starts = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    errors = []
    for part, own in zip(test.slices(), updated, strict=True):
        possible = np.ones(len(starts), dtype=bool)
        for k in range(part.start, own[-1] + 1):
            palm = starts + test.truth[k] - test.truth[part.start]
            finger = palm + OFFSETS_M[left] - FEATURE_CENTER_M
            possible &= (np.abs(finger) > COMES_BY_M).any(axis=1)
            possible &= ((palm >= scene.lower) & (palm <= scene.upper)).all(axis=1)
            if k in own:
                # On the sweeps that it does come by the feature on, none is left.
                expected = palm[possible if possible.any() else ...].mean(axis=0)
                errors.append(np.linalg.norm(expected - test.truth[k]))
    return np.array(errors)


def measure(seeds: Sequence[int], sweeps: int) -> list[dict[str, Any]]:
    """All of it, one seed after the other."""
    shares: Shares = defaultdict(list)
    errors: Errors = defaultdict(list)
    for seed in seeds:
        scans = candidates(seed)
        identifier, apart = (
            build_identifier(scans, Configuration(), np.random.default_rng(1)) for _ in range(2)
        )
        name_features(identifier, seed, sweeps, shares)
        for feature, (scan, scene) in scans.items():
            localizer = build_localizer(scan, scene, Configuration(), np.random.default_rng(1))
            lose_a_phalanx(localizer, feature, seed, sweeps, errors)
    ratio = cost(identifier, list(apart.localizers.values()), seeds[0])
    named = [
        row(f"feature named right: {name}", 100 * np.mean(each), "%", ">= 95")
        for name, each in shares.items()
    ]
    lost = [
        row(
            f"error, {kind}, to both",
            np.mean(errors[kind]) / np.mean(errors[f"both, for {kind}"]),
            "x",
            None if "observer" in kind else "<= 2",
        )
        for kind in errors
        if not kind.startswith("both")
    ]
    return [*named, row("cost of identifying, to the localizers'", ratio, "x", "<= 1"), *lost]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[51])
    parser.add_argument("--sweeps", type=int, default=18, help="over each material")
    args = parser.parse_args()
    record(measure(args.seeds, args.sweeps))
