"""``tactile-localizer demo``: scan a simulated feature and localize on it, with all nodes running."""

import argparse
import json
import os
import shlex
import shutil
import time
from contextlib import suppress
from pathlib import Path

from tactile_localizer.cli import main
from tactile_localizer.cli.outputs import output_path, require_picture, require_writable
from tactile_localizer.cli.recordings import add_seed_argument
from tactile_localizer.errors import LiveError, ParameterError, counted
from tactile_localizer.io.whole_file import is_result, open_file, writing
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.quantity import whole_number
from tactile_localizer.sim.material import SIMULATED_FEATURES

_FOLDERS = ("scan", "bag", "log")
_MARK = "log/session.json"
"""File in which a demo notes what it left, so that the next one replaces nothing else."""
_WIDTH = 79
"""Longest printed line, characters."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        "--feature", choices=SIMULATED_FEATURES, default="bump", help="feature in the material"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=output_path,
        default=Path("out/demo"),
        metavar="DIR",
        help="folder (default out/demo)",
    )
    add_seed_argument(parser)
    parser.add_argument(
        "--speed", type=float, default=10.0, help="simulation speed relative to real time (default 10)"
    )
    parser.add_argument("--sweeps", type=int, default=18, help="sweeps to localize (default 18)")


def run(args: argparse.Namespace) -> int:
    """Record the session of the nodes, and return the status of its replay, whatever was lost on the way.

    Raises
    ------
    LiveError
        A node failed, or the bag lacks a sweep.
    ParameterError
        There is no sweep to localize, or the folder has a scan, a bag or logs with a file that no earlier
        demo left there as it is.
    ScanError
        A file cannot be written or removed.
    """
    whole_number(args.sweeps, "--sweeps", lower=1)
    figures, picture = args.output / "replay.json", args.output / "replay.png"
    require_writable(figures, args)
    require_picture(picture, args)
    earlier = _earlier(args.output)
    from tactile_localizer.demo.session import record_session

    for path in earlier:
        with writing(path):
            shutil.rmtree(path)
    begun_s = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - begun_s:5.1f} s  {text}"[:_WIDTH], flush=True)

    try:
        lost = record_session(args.feature, args.output, args.seed, args.speed, args.sweeps, say)
    finally:
        write_json(args.output / _MARK, {"files": sorted(_files(args.output))})
    say(f"recorded: {counted(args.sweeps, 'sweep')}, {counted(lost, 'frame')} lost")
    replay = ["replay", f"{args.output}/bag", "--scan", f"{args.output}/scan"]
    replay += ["--plot", str(picture), "--json", str(figures)]
    print(f"\n$ tactile-localizer {shlex.join(replay[:4])} \\\n    {shlex.join(replay[4:])}", flush=True)
    status = main(replay)
    if (recorded := json.loads(figures.read_text())["summary"]["sweeps"]) != args.sweeps:
        raise LiveError(f"{args.output}/bag: expected {counted(args.sweeps, 'sweep')}, found {recorded}")
    return status


def _earlier(folder: Path) -> list[Path]:
    """Scan, bag and log in a folder, which must be as an earlier demo left them."""
    left: set[tuple[str, int, int]] = set()
    with suppress(OSError, ValueError, LookupError, TypeError), open_file(folder / _MARK) as mark:
        left = {(name, size, changed_ns) for name, size, changed_ns in json.load(mark)["files"]}
    if others := sorted(_files(folder) - left):
        file = Path(others[0][0])
        raise ParameterError(
            f"{folder / file.parts[0]}: expected none, or that of an earlier demo, found {file} of another "
            "origin or changed since; choose another folder"
        )
    return [path for name in _FOLDERS if os.path.lexists(path := folder / name)]


def _files(folder: Path) -> set[tuple[str, int, int]]:
    """Name, size and time of change, ns, of each file in scan, bag and log that no command makes again."""
    places = [folder / name for name in _FOLDERS]
    paths = [path for place in places for path in (place, *place.rglob("*")) if os.path.lexists(path)]
    status = {path: path.lstat() for path in paths if not (path.is_dir() or is_result(path))}
    return {(str(path.relative_to(folder)), each.st_size, each.st_mtime_ns) for path, each in status.items()}
