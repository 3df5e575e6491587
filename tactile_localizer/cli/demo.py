"""``tactile-localizer demo``: scan a simulated feature and localize on it, with all nodes running."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import time
from pathlib import Path

from tactile_localizer.cli import main
from tactile_localizer.cli.outputs import require_picture, require_writable
from tactile_localizer.cli.recordings import add_seed_argument
from tactile_localizer.errors import LiveError, ParameterError
from tactile_localizer.io.whole_file import RESULT, is_result, writing
from tactile_localizer.sim.material import SIMULATED_FEATURES

_MARK = "log/session.txt"
"""File by which a demo recognizes the folder of an earlier one."""
_WIDTH = 79
"""Longest printed line, characters."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        "--feature", choices=SIMULATED_FEATURES, default="bump", help="feature in the material"
    )
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/demo"), metavar="DIR", help="folder (default out/demo)"
    )
    add_seed_argument(parser)
    parser.add_argument(
        "--speed", type=float, default=10.0, help="simulation speed relative to real time (default 10)"
    )
    parser.add_argument("--sweeps", type=int, default=18, help="sweeps to localize (default 18)")


def run(args: argparse.Namespace) -> int:
    """Record the session of the nodes, and return the status of its replay.

    Raises
    ------
    LiveError
        A node failed, or a frame, a strain vector or a sweep was lost.
    ParameterError
        The folder has a scan, a bag or logs that no earlier demo left there.
    """
    figures, picture = args.out / "replay.json", args.out / "replay.png"
    require_writable(figures, args)
    require_picture(picture, args)
    earlier = _earlier(args.out)
    from tactile_localizer.demo.session import record_session

    for path in earlier:
        shutil.rmtree(path, ignore_errors=True)
    mark = args.out / _MARK
    with writing(mark):
        mark.parent.mkdir(parents=True)
        mark.write_text(f"{RESULT} demo: the next one in this folder replaces scan, bag and log\n")
    begun_s = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - begun_s:5.1f} s  {text}"[:_WIDTH], flush=True)

    lost = record_session(args.feature, args.out, args.seed, args.speed, args.sweeps, say)
    replay = ["replay", f"{args.out}/bag", "--scan", f"{args.out}/scan"]
    replay += ["--plot", str(picture), "--json", str(figures)]
    print(f"\n$ tactile-localizer {shlex.join(replay[:4])} \\\n    {shlex.join(replay[4:])}", flush=True)
    status = main(replay)
    if lost:
        raise LiveError(f"expected every frame in the bag, {lost} were lost; the machine is too busy")
    if (recorded := json.loads(figures.read_text())["summary"]["sweeps"]) != args.sweeps:
        raise LiveError(
            f"expected {args.sweeps} sweeps in the bag, found {recorded}; the machine is too busy"
        )
    return status


def _earlier(folder: Path) -> list[Path]:
    """Scan, bag and log in a folder, which must be those of an earlier demo."""
    found = [path for name in ("scan", "bag", "log") if os.path.lexists(path := folder / name)]
    if found and not is_result(folder / _MARK):
        raise ParameterError(
            f"{found[0]}: expected none, or that of an earlier demo, found another; choose another folder"
        )
    return found
