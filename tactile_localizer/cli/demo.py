"""``tactile-localizer demo``: scan a simulated feature and localize on it, with all nodes running."""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.errors import LiveError, ParameterError
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.library import load_scan
from tactile_localizer.offline.figures.tactile_map import DrawnScan, map_pair
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.material import SIMULATED_FEATURES


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
    """Run the demonstration, print its summary, and write it with figures."""
    _check(args)
    from tactile_localizer.demo.show import (
        LIMIT_M,
        SCAN_SWEEPS,
        DemoSettings,
        View,
        run_demo,
        summarize,
    )

    begun_s = time.monotonic()
    console = Console(markup=False, emoji=False)
    scene = load_scene(resource_path(f"config/scenes/{args.feature}.yaml"))
    settings = DemoSettings(args.feature, args.out, args.seed, args.speed, args.sweeps)
    console.print(f"{args.feature}: from CAN frames and palm poses to a converged position")
    with View(console, scene) as view:
        sweeps, counts = run_demo(settings, view)
    summary = {
        "feature": args.feature,
        "seed": args.seed,
        "speed": args.speed,
        "training_sweeps": SCAN_SWEEPS,
        "limit_mm": LIMIT_M * 1e3,
        **counts,
        **summarize(sweeps),
    }
    scan, scene = load_scan(settings.scan)
    map_pair(DrawnScan(scan, scene)).savefig(args.out / "map.png", dpi=110)
    summary["duration_s"] = round(time.monotonic() - begun_s, 1)
    write_json(args.out / "summary.json", summary, rows="sweeps")
    _print(console, summary, args.out)
    return 0


def _check(args: argparse.Namespace) -> None:
    if importlib.util.find_spec("rclpy") is None:
        raise LiveError("rclpy: expected ROS 2, found none; `make demo` makes an environment that has it")
    if not 0.1 <= args.speed <= 100.0:
        raise ParameterError(f"--speed: expected 0.1 to 100, got {args.speed:g}")
    if args.sweeps < 1:
        raise ParameterError(f"--sweeps: expected at least 1, got {args.sweeps}")


def _print(console: Console, summary: Mapping[str, Any], folder: Path) -> None:
    table = Table(box=SIMPLE, show_header=False)
    error = summary["error_after_contact_mm"]
    limit = f"limit {summary['limit_mm']:.2f} mm, 0.1 inch"
    shown = "no contact" if error is None else f"{error:.2f} mm ({limit})"
    travel, duration = summary["travel_to_convergence_mm"], summary["time_to_convergence_s"]
    convergence = "never" if travel is None else f"{duration:.2f} s, {travel:.1f} mm"
    table.add_row("training sweeps", f"{summary['training_sweeps']}, two along each line")
    converged, count = summary["error_converged_mm"], len(summary["sweeps"])
    table.add_row("mean error after contact", shown)
    table.add_row("mean error while converged", "never" if converged is None else f"{converged:.2f} mm")
    table.add_row("time and travel to convergence", convergence)
    table.add_row("sweeps that converged", f"{summary['converged_sweeps']} of {count}")
    table.add_row("converged before contact", str(summary["converged_before_contact"]))
    table.add_row("frames dropped", str(summary["frames_dropped"]))
    table.add_row(
        "update time", f"median {summary['update_median_us']:.0f} µs, 99 % {summary['update_p99_us']:.0f} µs"
    )
    table.add_row("total time", f"{summary['duration_s']:.0f} s, written to {folder}")
    console.print(table)
    console.print(
        "within 0.1 inch after contact" if summary["within_limit"] else "NOT within 0.1 inch after contact"
    )
