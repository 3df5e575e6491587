"""What evaluations are tried on, and who does the work, as a command line says it."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from tactile_localizer.cli.recordings import (
    add_recording_arguments,
    add_start_arguments,
    check_starts,
    read_recordings,
    scan_from_arguments,
)
from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.offline.evaluation.conditions import (
    SIMULATED_FEATURES,
    Condition,
    RecordedCondition,
    SimulatedCondition,
)
from tactile_localizer.offline.evaluation.fabric import FABRICS, fabric_condition

DATA = "TACTILE_LOCALIZER_DATA"
"""Names the directory of recorded data in the environment."""


def add_condition_arguments(parser: argparse.ArgumentParser, sweeps: int, seeds: int, blanks: bool) -> None:
    """Declare what to try on: simulated features, or own recordings on an own scan."""
    parser.add_argument(
        "--features",
        nargs="+",
        choices=(*SIMULATED_FEATURES, *FABRICS),
        default=SIMULATED_FEATURES,
        help=f"default: {', '.join(SIMULATED_FEATURES)}; fabrics need --data; none of it with recordings",
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=os.environ.get(DATA),
        metavar="DIR",
        help=f"holds fabric_slide/*.csv (default: {DATA} of the environment)",
    )
    parser.add_argument(
        "--sweeps", type=int, default=sweeps, metavar="N", help=f"simulated test sweeps (default {sweeps})"
    )
    if blanks:
        parser.add_argument(
            "--blanks", type=int, default=18, metavar="N", help="sweeps that reach nothing (default 18)"
        )
    parser.add_argument(
        "--seeds", type=int, default=seeds, metavar="N", help=f"repetitions (default {seeds})"
    )
    parser.add_argument("--scan", metavar="SCAN", help="scan file, to evaluate on own recordings")
    parser.add_argument("--scene", help="scene file (default: the scan's)")
    add_recording_arguments(parser, "*")
    add_start_arguments(parser)


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare who does the work."""
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes (default 1; -1: all cores)"
    )
    parser.add_argument("--dask", metavar="ADDRESS", help="do the work on this dask cluster")


def conditions_from_arguments(args: argparse.Namespace) -> list[Condition]:
    """What ``add_condition_arguments`` has declared.

    Raises
    ------
    ParameterError, ScanError
        A count out of its range, or recordings without a scan or the other way round.
    """
    for name in ("sweeps", "seeds"):
        if getattr(args, name) < 1:
            raise ParameterError(f"--{name}: expected at least 1, got {getattr(args, name)}")
    blanks = getattr(args, "blanks", 0)
    if blanks < 0:
        raise ParameterError(f"--blanks: expected at least 0, got {blanks}")
    seeds = range(1, args.seeds + 1)
    if args.scan is None:
        if args.recordings:
            raise ParameterError("recordings: expected --scan with them")
        return [
            _fabric(name, seed, args.data)
            if name in FABRICS
            else SimulatedCondition(name, seed, args.sweeps, blanks)
            for name in args.features
            for seed in seeds
        ]
    if not args.recordings:
        raise ScanError(f"{args.scan}: expected recordings to localise on it")
    scan, scene = scan_from_arguments(args)
    recording, _ = read_recordings(args, scene)
    check_starts(args)
    return [
        RecordedCondition(scene.name, seed, scan, scene, recording, args.starts, args.travel)
        for seed in seeds
    ]


def _fabric(name: str, seed: int, folder: Path | None) -> Condition:
    if folder is None:
        raise ParameterError(f"--features {name}: expected --data or {DATA} to say where the recordings are")
    return fabric_condition(name, seed, Path(folder) / "fabric_slide")
