"""``tactile-localizer scan``: inspect, plot, repair and convert scan files."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.errors import ScanError, printable
from tactile_localizer.io.scans.export import export_scan
from tactile_localizer.io.scans.repair import repair
from tactile_localizer.io.scans.rows import SweepInfo
from tactile_localizer.io.scans.store import ScanStore, new_scan
from tactile_localizer.io.scene_file import load_scene, save_scene, scene_to_dict
from tactile_localizer.offline.axes import INCH_MM, MM
from tactile_localizer.offline.scan_quality import findings
from tactile_localizer.offline.table import Table
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Phalanx, Scene

_LIST_COLUMNS = (
    "sweep", "pairs", "s", "pairs/s", "length mm", "inch", "from mm", "to mm", "gaps", "skipped", "",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions and their options."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str, work: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
        added = actions.add_parser(name, help=text, description=f"{text[:1].upper()}{text[1:]}.")
        added.set_defaults(work=work)
        return added

    for name, text, work in (
        ("info", "totals, history, and findings that need attention", _info),
        ("list", "list the sweeps with lengths and rates", _list),
    ):
        action(name, text, work).add_argument("scan", metavar="SCAN")
    drop = action("drop-sweep", "exclude sweeps from the map; their pairs stay in the file", _drop)
    drop.add_argument("scan", metavar="SCAN")
    drop.add_argument("numbers", nargs="+", type=int, metavar="NUMBER")
    drop.add_argument("--undo", action="store_true", help="include them again")
    mend = action(
        "repair", "recover the undamaged pairs of a damaged file, which is kept beside the new one", _repair
    )
    mend.add_argument("scan", metavar="SCAN")
    mend.add_argument(
        "--scene", metavar="SCENE", help="scene of the scan (YAML), needed if the file's header is damaged"
    )
    merge = action("merge", "merge several files of one scene into a new one", _merge)
    merge.add_argument("scans", nargs="+", metavar="SCAN")
    merge.add_argument("-o", "--output", required=True, metavar="SCAN", help="scan file to create")
    export = action("export", "write the pairs as CSV or npz", _export)
    export.add_argument("scan", metavar="SCAN")
    export.add_argument("-o", "--output", required=True, metavar="FILE", help="*.csv or *.npz")
    region = action("region", "propose the feature's region", _region)
    region.add_argument("scan", metavar="SCAN")
    region.add_argument(
        "-o", "--output", metavar="SCENE", help="write the scan's scene with the region (YAML)"
    )
    plot = action(
        "plot", "draw the tactile map, the sweeps, neighbouring values and the feature's region", _plot
    )
    plot.add_argument("scan", metavar="SCAN")
    plot.add_argument(
        "-o", "--output", type=Path, default=Path("out/plot"), metavar="DIR", help="folder (default out/plot)"
    )
    plot.add_argument("--dpi", type=int, default=120, help="resolution of the figures (default 120)")


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    work: Callable[[argparse.Namespace], int] = args.work
    return work(args)


def _info(args: argparse.Namespace) -> int:
    with ScanStore.open(args.scan) as store:
        scene, sweeps = store.scene, store.sweeps()
        kept = [sweep for sweep in sweeps if not sweep.dropped]
        pairs = sum(sweep.pairs for sweep in kept)
        dropped = f" ({len(sweeps) - len(kept)} dropped)" if len(kept) < len(sweeps) else ""
        print(f"{args.scan}: {pairs} pairs in {len(kept)} sweeps{dropped}")
        bounds = ", ".join(f"{axis.name} {_range(axis.name, axis.lower, axis.upper)}" for axis in scene.axes)
        print(f"  scene      {scene.name}: {bounds}")
        print(f"  phalanges  {', '.join(map(_phalanx, scene.phalanges))}, strain in {store.units['strain']}")
        print(f"  recorded   {_when(sweeps)}")
        if not store.has_checksums:
            print("  checksums  none (earlier version); added when the file is next written")
        for at, what, detail in store.history():
            print(f"  history    {printable(f'{at} {what}{_detail(detail)}')}")
            notes = detail.get("notes")
            for note in notes if isinstance(notes, list) else ():
                print(f"               {printable(str(note))}")
        found = ["no pairs"]
        if pairs:
            with progress_bars() as progress:
                scan = store.load(progress=partial(progress, "reading the pairs"))
                unit = store.units["strain"]
                found = findings(scan, scene, sweeps, unit, partial(progress, "checking the scan"))
    print("findings:" if found else "no findings")
    for finding in found:
        print(f"  {finding}")
    return 0


def _phalanx(phalanx: Phalanx) -> str:
    """Name of a phalanx, with its number of channels unless that is the default."""
    if phalanx.channels == DEFAULT_CHANNELS:
        return phalanx.name
    return f"{phalanx.name} ({phalanx.channels} channels)"


def _list(args: argparse.Namespace) -> int:
    with ScanStore.open(args.scan) as store:
        sweeps = store.sweeps()
        recorded = {sweep.number: sweep for sweep in store.recording().sweeps}
        axes = store.scene.axis_names
    rows = []
    plane = [column for column, axis in enumerate(axes) if axis != "yaw"]
    for info in sweeps:
        duration = (info.last_ns - info.first_ns) * 1e-9
        cells = [str(info.number), str(info.pairs), f"{duration:.1f}"]
        cells.append(f"{(info.pairs - 1) / duration:.0f}" if duration > 0 else "")
        sweep = recorded.get(info.number)
        if sweep is None:
            cells += [""] * 4
        else:
            ends = sweep.position[[0, -1]][:, plane] * MM
            length = float(np.linalg.norm(ends[1] - ends[0]))
            cells += [f"{length:.1f}", f"{length / INCH_MM:.2f}", *(_place(end) for end in ends)]
        remark = "dropped" if info.dropped else "" if info.ended else "interrupted"
        rows.append((*cells, str(info.gaps), str(info.skipped), remark))
    print_tables([Table("", _LIST_COLUMNS, rows)])
    return 0


def _drop(args: argparse.Namespace) -> int:
    with ScanStore.open(args.scan, writable=True) as store:
        known = {sweep.number for sweep in store.sweeps()}
        for number in args.numbers:
            if number not in known:
                store.drop_sweep(number)  # raises before any is dropped
        for number in args.numbers:
            store.drop_sweep(number, dropped=not args.undo)
        left = [sweep for sweep in store.sweeps() if not sweep.dropped]
    print(f"{args.scan}: {sum(sweep.pairs for sweep in left)} pairs in {len(left)} sweeps")
    return 0


def _repair(args: argparse.Namespace) -> int:
    scene = load_scene(given_or_shipped(args.scene, "config/scenes")) if args.scene else None
    report = repair(args.scan, scene)
    if report.damaged is None:
        print(f"{args.scan}: nothing to repair, {report.pairs} pairs in {report.sweeps} sweeps are undamaged")
        return 0
    for note in report.notes:
        print(f"  {note}")
    print(f"{args.scan}: kept {report.pairs} pairs in {report.sweeps} sweeps")
    print(f"the damaged file is now {report.damaged}")
    return 0


def _merge(args: argparse.Namespace) -> int:
    with ScanStore.open(args.scans[0]) as first:
        scene, unit = first.scene, first.units["strain"]
    with new_scan(args.output, scene, strain_unit=unit) as store:
        for path in args.scans:
            with ScanStore.open(path) as other:
                store.merge(other)
        sweeps, pairs = len(store.sweeps()), store.pairs
    print(f"{args.output}: {sweeps} sweeps, {pairs} pairs")
    return 0


def _export(args: argparse.Namespace) -> int:
    with ScanStore.open(args.scan) as store:
        export_scan(store, args.output)
    print(args.output)
    return 0


def _region(args: argparse.Namespace) -> int:
    # An import of half a second that other actions do not need.
    from tactile_localizer.core.calibration.feature_region import propose_region

    with ScanStore.open(args.scan) as store:
        scan, scene = store.load(), store.scene
    proposal = propose_region(scan, scene)
    if scene.feature is not None:
        print(f"{args.scan}: region given by the scene\n{_box(scene)}")
    if proposal.region is None:
        print(f"{args.scan}: no region found: the material is textured everywhere, or featureless")
        return 0
    proposed = replace(scene, feature=proposal.region)
    print(f"{args.scan}: proposed region of the feature\n{_box(proposed)}")
    sides = ", ".join(
        f"{axis}: [{low:.4f}, {high:.4f}]" for axis, (low, high) in scene_to_dict(proposed)["feature"].items()
    )
    print(f"as a line of the scene file:\nfeature: {{{sides}}}")
    if args.output:
        save_scene(proposed, args.output)
        print(f"written to {args.output}")
    return 0


def _box(scene: Scene) -> str:
    region = scene.feature
    assert region is not None
    limits = zip(scene.axis_names, region.lower, region.upper, strict=True)
    return "\n".join(f"  {axis} {_range(axis, lower, upper)}" for axis, lower, upper in limits)


def _plot(args: argparse.Namespace) -> int:
    # Importing matplotlib takes a second; no other action needs it.
    from tactile_localizer.core.calibration.feature_region import propose_region
    from tactile_localizer.offline.figures.feature_region import region_sheet
    from tactile_localizer.offline.figures.tactile_map import DrawnScan, scan_figures

    with ScanStore.open(args.scan) as store:
        scan, scene, unit = store.load(), store.scene, store.units["strain"]
    try:
        args.output.mkdir(parents=True, exist_ok=True)
        drawn = DrawnScan(scan, scene, unit)
        figures = {**scan_figures(drawn), "region": region_sheet(drawn, propose_region(scan, scene))}
        for name, figure in figures.items():
            path = args.output / f"{name.replace('/', '_')}.png"
            figure.savefig(path, dpi=args.dpi)
            print(path)
    except OSError as error:
        raise ScanError(f"{args.output}: expected a folder for the figures, {error.strerror}") from None
    return 0


def _range(axis: str, lower: float, upper: float) -> str:
    if axis == "yaw":
        return f"{np.degrees(lower):.1f} to {np.degrees(upper):.1f} degrees"
    low, high = lower * MM, upper * MM
    return f"{low:.1f} to {high:.1f} mm ({low / INCH_MM:.2f} to {high / INCH_MM:.2f} inch)"


def _place(position_mm: np.ndarray) -> str:
    return " ".join(f"{value:.1f}" for value in position_mm)


def _when(sweeps: list[SweepInfo]) -> str:
    """First and last stamp as dates, or in seconds if they are not Unix time."""
    ends = [end for sweep in sweeps if sweep.pairs for end in (sweep.first_ns, sweep.last_ns)]
    if not ends:
        return "never"
    first, last = min(ends) * 1e-9, max(ends) * 1e-9
    if first < 1e9:
        return f"{first:.1f} to {last:.1f} s"
    dates = [datetime.fromtimestamp(end, timezone.utc) for end in (first, last)]
    return f"{dates[0]:%Y-%m-%d %H:%M:%S} to {dates[1]:%Y-%m-%d %H:%M:%S} UTC"


def _detail(detail: dict[str, object]) -> str:
    elsewhere = ("version", "history", "notes")
    shown = {key: value for key, value in detail.items() if key not in elsewhere and value}
    return ": " + ", ".join(f"{key} {value}" for key, value in shown.items()) if shown else ""
