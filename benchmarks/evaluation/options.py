"""Command-line options of an evaluation, and its exit status."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from evaluation.conditions import (
    Condition,
    RecordedCondition,
    SimulatedCondition,
)
from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.recordings import (
    add_recording_arguments,
    add_start_arguments,
    check_starts,
    read_recordings,
    scan_from_arguments,
)
from tactile_localizer.errors import ParameterError, ScanError, TactileLocalizerError
from tactile_localizer.sim.material import SIMULATED_FEATURES


def exit_status(work: Callable[[], int]) -> int:
    """Exit status of ``work``; 2 for an invalid request and 130 for an interrupt, with one line on stderr."""
    end_as_by_interrupt()
    try:
        return work()
    except TactileLocalizerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: finished tasks are kept, run the command again to resume", file=sys.stderr)
        return 130


def add_condition_arguments(parser: argparse.ArgumentParser, sweeps: int, seeds: int) -> None:
    """Declare the conditions: simulated features, or recordings on a scan."""
    parser.add_argument(
        "--features",
        nargs="+",
        choices=SIMULATED_FEATURES,
        default=SIMULATED_FEATURES,
        help=f"simulated features (default: {', '.join(SIMULATED_FEATURES)}); not with recordings",
    )
    parser.add_argument(
        "--sweeps", type=int, default=sweeps, metavar="N", help=f"simulated test sweeps (default {sweeps})"
    )
    parser.add_argument(
        "--seeds", type=int, default=seeds, metavar="N", help=f"number of random seeds (default {seeds})"
    )
    parser.add_argument("--scan", metavar="SCAN", help="scan file to evaluate recordings on")
    parser.add_argument("--scene", help="scene file (default: the scan's)")
    add_recording_arguments(parser, "*")
    add_start_arguments(parser)


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the workers."""
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes (default 1; -1: all cores)"
    )
    parser.add_argument("--dask", metavar="ADDRESS", help="run on this dask cluster")


def conditions_from_arguments(args: argparse.Namespace, blanks: int = 0) -> list[Condition]:
    """The conditions of ``add_condition_arguments``, with ``blanks`` simulated sweeps before the feature.

    Raises
    ------
    ParameterError, ScanError
        A number is out of range, or only one of recordings and scan is given.
    """
    for name in ("sweeps", "seeds"):
        if getattr(args, name) < 1:
            raise ParameterError(f"--{name}: expected at least 1, got {getattr(args, name)}")
    seeds = range(1, args.seeds + 1)
    if args.scan is None:
        if args.recordings:
            raise ParameterError("recordings: expected --scan with them, found none")
        return [
            SimulatedCondition(name, seed, args.sweeps, blanks) for name in args.features for seed in seeds
        ]
    if not args.recordings:
        raise ScanError(f"{args.scan}: expected recordings to localize on it, found none")
    scan, scene = scan_from_arguments(args)
    recording, _ = read_recordings(args, scene)
    check_starts(args)
    return [
        RecordedCondition(scene.name, seed, scan, scene, recording, args.starts, args.travel)
        for seed in seeds
    ]
