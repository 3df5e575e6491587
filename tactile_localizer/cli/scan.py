"""``tactile-localizer scan``: describe and plot a scan."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.cli.outputs import (
    InputPath,
    output_path,
    require_picture,
    results,
    write_picture,
    write_report,
)
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import counted, printable
from tactile_localizer.io.recording import delay_of, scan_of
from tactile_localizer.io.scans.folder import DROPPED, ScanFolder
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.offline.examination import (
    describe_examination,
    examination_document,
    examination_findings,
)
from tactile_localizer.offline.scan_quality import findings
from tactile_localizer.scene import Scene
from tactile_localizer.streams.delay import HIDDEN


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions and their options."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    info = actions.add_parser("info", help="totals, history, and findings that need attention")
    info.set_defaults(work=_info)
    info.add_argument(
        "--report", type=output_path, metavar="FILE", help="write a report to send (one HTML file)"
    )
    info.add_argument(
        "--json", type=output_path, metavar="FILE", help="write examination and findings (-: as replay)"
    )
    plot = actions.add_parser("plot", help="draw the sweeps and the tactile map")
    plot.set_defaults(work=_plot)
    text = "folder (default out/plot)"
    plot.add_argument("-o", "--output", type=output_path, default=Path("out/plot"), metavar="DIR", help=text)
    for action in (info, plot):
        action.add_argument("scan", type=InputPath, metavar="SCAN", help="folder of the scan")


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    return args.work(args)


def _info(args: argparse.Namespace) -> int:
    with results(args) as write:
        return _described(args, write)


def _described(args: argparse.Namespace, write: Callable[[dict[str, Any]], None]) -> int:
    folder = ScanFolder(args.scan)
    scene, recording = folder.scene, folder.recording()
    sweeps = recording.sweeps
    found, examination, delay = ["no pairs"], Examination(), ""
    if len(recording):
        scan = scan_of(recording, scene)
        found, estimate = findings(scan, scene, sweeps), delay_of(recording, scene.axes)
        delay = HIDDEN if estimate is None else str(estimate)
        found += [f"{delay}; import it again"] * (estimate is not None and estimate.is_significant)
        examination = examined(args.scan, scan, scene)
        found += examination_findings(scene, examination)
    dropped = len(folder.files(DROPPED)[0])
    axes = ", ".join(f"{axis.name} {axis.lower:g} to {axis.upper:g}" for axis in scene.axes)
    phalanges = ", ".join(f"{each.name} ({each.channels} channels)" for each in scene.phalanges)
    lines = [
        f"{args.scan}: {counted(len(recording), 'pair')} in {counted(len(sweeps), 'sweep')} "
        f"({dropped} dropped)",
        f"  scene      {scene.name}: {axes} (m, rad)",
        f"  phalanges  {phalanges}, strain in {sweeps[0].strain_unit if sweeps else 'V'}",
    ]
    if len(recording):
        stamps = np.concatenate([sweep.stamp_ns for sweep in sweeps]) * 1e-9
        lines.append(f"  recorded   {stamps.min():.1f} to {stamps.max():.1f} s")
    lines += [f"  delay      {delay}"] * bool(delay)
    for entry in folder.history():
        details = [f"{key} {value}" for key, value in entry.items() if value and key not in ("at", "what")]
        lines.append(f"  history    {entry['at']} {entry['what']}: {', '.join(details)}")
    lines += [f"  examined   {line}" for line in describe_examination(scene, examination)]
    lines, found = [*map(printable, lines)], [*map(printable, (*recording.notes, *found))]
    print(*lines, "findings:" if found else "no findings", *(f"  {each}" for each in found), sep="\n")
    write({"examination": examination_document(examination), "findings": found})
    if args.report is not None:
        from tactile_localizer.offline.reports.scan import scan_report

        report = args.scan, scan_of(recording, scene), scene, recording, lines, found, examination
        write_report(args.report, lambda: scan_report(*report))
    return 0


def examined(path: str | Path, scan: Scan, scene: Scene) -> Examination:
    """The examination of a scan, kept in its folder or made now, with progress."""
    with progress_line() as progress:
        return learned_calibration(path, scan, scene, progress).examination


def _picture(folder: Path, name: str) -> Path:
    return folder / f"{name.replace('/', '_')}.png"


def _plot(args: argparse.Namespace) -> int:
    folder = ScanFolder(args.scan)
    for phalanx in folder.scene.phalanx_names:
        require_picture(_picture(args.output, f"map_{phalanx}"), args)
    # Importing matplotlib takes a second; no other action needs it.
    from tactile_localizer.offline.figures.tactile_map import MapFigures

    figures = MapFigures(folder.load(), folder.scene, folder.recording().sweeps[0].strain_unit)
    for name, figure in figures.channels().items():
        write_picture(_picture(args.output, name), figure)
    return 0
