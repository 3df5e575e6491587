"""``tactile-localizer scan``: describe and plot a scan."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.errors import ScanError, printable
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.axes import INCH_MM, MM
from tactile_localizer.offline.scan_quality import findings

_NOT_DETAILS = ("at", "what", "version", "notes")
"""Keys of a history's entry that are not printed as details."""

_FIRST_DATE_S = 1e9
"""Stamps before this time, s, are not Unix time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions and their options."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    info = actions.add_parser("info", help="totals, history, and findings that need attention")
    info.set_defaults(work=_info)
    info.add_argument("--json", action="store_true", help="print them as JSON, with every sweep")
    plot = actions.add_parser("plot", help="draw the sweeps and the tactile map")
    plot.set_defaults(work=_plot)
    plot.add_argument(
        "-o", "--output", type=Path, default=Path("out/plot"), metavar="DIR", help="folder (default out/plot)"
    )
    plot.add_argument("--dpi", type=int, default=120, help="resolution of the figures (default 120)")
    for action in (info, plot):
        action.add_argument("scan", metavar="SCAN", help="folder of the scan")


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    work: Callable[[argparse.Namespace], int] = args.work
    return work(args)


def _info(args: argparse.Namespace) -> int:
    folder = ScanFolder(args.scan)
    sweeps, history = folder.sweeps(), folder.history()
    pairs = sum(map(len, sweeps))
    found = findings(folder.load(), folder.scene, sweeps) if pairs else ["no pairs"]
    document = {
        "scan": str(folder.path),
        "scene": scene_to_dict(folder.scene),
        "pairs": pairs,
        "sweeps": list(map(_described, sweeps)),
        "dropped": [file.name for file in folder.dropped_files()],
        "history": history,
        "findings": found,
    }
    if args.json:
        print(json.dumps(document, indent=2))
    else:
        _print(folder, sweeps, document)
    return 0


def _described(sweep: RecordedSweep) -> dict[str, Any]:
    names = ("number", "started_ns", "ended_ns", "gaps", "skipped", "ending", "strain_unit")
    return {"pairs": len(sweep), **{name: getattr(sweep, name) for name in names}}


def _print(folder: ScanFolder, sweeps: Sequence[RecordedSweep], document: dict[str, Any]) -> None:
    scene = folder.scene
    dropped = f" ({len(document['dropped'])} dropped)" if document["dropped"] else ""
    print(f"{folder.path}: {document['pairs']} pairs in {len(sweeps)} sweeps{dropped}")
    bounds = ", ".join(f"{axis.name} {_range(axis.name, axis.lower, axis.upper)}" for axis in scene.axes)
    print(f"  scene      {scene.name}: {bounds}")
    phalanges = ", ".join(
        phalanx.name + (f" ({phalanx.channels} channels)" if phalanx.channels != DEFAULT_CHANNELS else "")
        for phalanx in scene.phalanges
    )
    print(f"  phalanges  {phalanges}, strain in {sweeps[0].strain_unit if sweeps else 'V'}")
    print(f"  recorded   {_when(sweeps)}")
    for entry in document["history"]:
        details = {key: value for key, value in entry.items() if value and key not in _NOT_DETAILS}
        shown = ", ".join(f"{key} {value}" for key, value in details.items())
        line = f"{entry['at']} {entry['what']}" + (f": {shown}" if shown else "")
        print(f"  history    {printable(line)}")
        notes = entry.get("notes")
        for note in notes if isinstance(notes, list) else ():
            print(f"               {printable(str(note))}")
    print("findings:" if document["findings"] else "no findings")
    for finding in document["findings"]:
        print(f"  {finding}")


def _plot(args: argparse.Namespace) -> int:
    # Importing matplotlib takes a second; no other action needs it.
    from tactile_localizer.offline.figures.tactile_map import DrawnScan, scan_figures

    folder = ScanFolder(args.scan)
    drawn = DrawnScan(folder.load(), folder.scene, folder.sweeps()[0].strain_unit)
    try:
        args.output.mkdir(parents=True, exist_ok=True)
        for name, figure in scan_figures(drawn).items():
            path = args.output / f"{name.replace('/', '_')}.png"
            figure.savefig(path, dpi=args.dpi)
            print(path)
    except OSError as error:
        raise ScanError(f"{args.output}: expected a folder for the figures, {error.strerror}") from None
    return 0


def _range(axis: str, lower: float, upper: float) -> str:
    if axis == "yaw":
        return f"{math.degrees(lower):.1f} to {math.degrees(upper):.1f} degrees"
    low, high = lower * MM, upper * MM
    return f"{low:.1f} to {high:.1f} mm ({low / INCH_MM:.2f} to {high / INCH_MM:.2f} inch)"


def _when(sweeps: Sequence[RecordedSweep]) -> str:
    """First and last stamp as dates, or in seconds if they are not Unix time."""
    ends = [end * 1e-9 for sweep in sweeps if len(sweep) for end in (sweep.started_ns, sweep.ended_ns)]
    if not ends:
        return "never"
    if min(ends) < _FIRST_DATE_S:
        return f"{min(ends):.1f} to {max(ends):.1f} s"
    first, last = (datetime.fromtimestamp(end, timezone.utc) for end in (min(ends), max(ends)))
    return f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"
