"""Speed of this package's particle filter against four other packages, on the same model.

The packages provide the filter; the model is what their user would write in numpy and scipy: strain distances
once for all particles, then position kernels. All run in one process in a separate environment
(``.venv-bench``, from ``requirements/bench.txt``) and take turns, so that noise affects all alike.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/peers.py``.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = ROOT / ".venv-bench"
REQUIREMENTS = ROOT / "requirements" / "bench.txt"
SPEED_UPS = {75: 4.0, 1_000: 50.0, 10_000: 100.0}
"""Required speed-up over the fastest peer, by number of particles."""
ROUNDS = {75: 40, 1_000: 15, 10_000: 5}
"""Rounds by number of particles; in each a peer makes five updates (one at 10,000)."""
OWN_UPDATES = 20
"""Updates of this package's filter in a round."""


def environment() -> Path:
    """Interpreter of the peers' environment, which is created if it is missing or out of date."""
    python, stamp = ENVIRONMENT / "bin" / "python", ENVIRONMENT / ".complete"
    want = hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()
    if not (stamp.exists() and stamp.read_text() == want):
        print(f"creating {ENVIRONMENT.name} with the other packages (a minute or two)", flush=True)
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        for command in (
            [sys.executable, "-m", "venv", "--clear", ENVIRONMENT],
            [*pip, "-r", REQUIREMENTS, "scipy>=1.11", "pyyaml"],
        ):
            if subprocess.run(command, check=False).returncode != 0:
                sys.exit(f"{ENVIRONMENT.name}: could not be created; benchmarks/peers.py needs PyPI once")
        stamp.write_text(want)
    return python


def compare() -> list[dict[str, Any]]:
    """Rows of this package's filter and of every peer, by number of particles."""
    import numpy as np
    from peer_filters import PEERS, PlainModel
    from workload import (
        PAIRS,
        POSITION_STD,
        PRESENT,
        STRAIN_STD,
        Stopwatch,
        bump_scan,
        bump_scene,
        floor_us,
        peak_mb,
        tv_to_exact,
    )

    from tactile_localizer.core.filters.particle import ParticleFilter
    from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians

    scan, scene = bump_scan(), bump_scene()
    floor = floor_us(scan)
    plain, model = (
        PlainModel(scan, POSITION_STD, STRAIN_STD),
        SumOfGaussians(scan, scene, POSITION_STD, STRAIN_STD),
    )
    rows = []

    def ours(particles: int) -> Stopwatch:
        bayes = ParticleFilter(scene, np.random.default_rng(0), particles, resample_below=1.0)

        def run(displacement: np.ndarray, strain: np.ndarray) -> None:
            bayes.predict(displacement, float(np.hypot(*displacement)))
            states, _ = bayes.prior()
            bayes.update(model.log_likelihood(states, strain, PRESENT))

        return Stopwatch(run, lambda _: bayes.reset(), every_step=True)

    def peer(make: Callable[..., Any], particles: int) -> Stopwatch:
        theirs = make(plain, scene, particles)
        return Stopwatch(theirs.step, lambda _: theirs.spread(), every_step=True)

    for particles, rounds in ROUNDS.items():
        watches = {"tactile_localizer": ours(particles)}
        watches |= {name: peer(make, particles) for name, make in PEERS.items()}
        own = watches["tactile_localizer"]
        _take_turns(own, list(watches.values())[1:], rounds, 1 if particles == 10_000 else 5)
        for name, watch in watches.items():
            likelihood = model.log_likelihood if watch is own else plain.log_likelihood
            fresh = ours(particles) if watch is own else peer(PEERS[name], particles)
            rows.append(
                {
                    "name": f"{particles} particles: {name}",
                    "value": watch.median_us,
                    "unit": "us",
                    "particles": particles,
                    "pairs": PAIRS,
                    "median_us": watch.median_us,
                    "p99_us": watch.p99_us,
                    "peak_mb": peak_mb(fresh.step),
                    "ratio_to_floor": watch.median_us / floor,
                    "tv_to_exact": tv_to_exact(scene, plain.log_likelihood, likelihood, converged=False),
                    "samples": len(watch.times),
                    "numpy": np.__version__,
                    "times_ours": watch.median_us / own.median_us,
                }
            )
    return rows


def _take_turns(own: Any, peers: list[Any], rounds: int, updates: int) -> None:
    """Update the filters in turn, after one update each that does not count."""
    for watch in (own, *peers):
        watch.step()
        watch.times.clear()
    for _ in range(rounds):
        for _ in range(OWN_UPDATES):
            own.step()
        for watch in peers:
            for _ in range(updates):
                watch.step()


def main() -> None:
    """Measure in the peers' environment and record in this one."""
    if sys.argv[1:] == ["--measure"]:
        sys.path[:0] = [str(ROOT)]
        json.dump(compare(), sys.stdout)
        return
    from record import record, row

    command = [environment(), __file__, "--measure"]
    measured = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout)
    rows = [row(one.pop("name"), one.pop("value"), one.pop("unit"), **one) for one in measured]
    measured_rows = list(rows)
    for particles, wanted in SPEED_UPS.items():
        peers = [one for one in measured_rows if one["particles"] == particles and one["times_ours"] != 1.0]
        fastest = min(peers, key=lambda one: one["times_ours"])
        rows.append(
            row(
                f"{particles} particles: speed-up over the fastest peer",
                fastest["times_ours"],
                "x",
                f">= {wanted:g}",
                peer=fastest["name"].rpartition(" ")[2],
            )
        )
    record(rows)


if __name__ == "__main__":
    main()
