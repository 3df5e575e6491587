"""Soak test: runs the live system under randomly injected faults (``make soak MINUTES=30 SEED=7``)."""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.seeds import add_seed_argument
from tactile_localizer.errors import LiveError, ParameterError, TactileLocalizerError
from tactile_localizer.offline.json_file import write_json

if TYPE_CHECKING:
    from harness.soak_result import Injection, SoakResult


def main() -> int:
    """Parse the command line and run the soak test; an error is one line."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # for the nodes, whose matrices are small
        os.environ.setdefault(name, "1")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="duration (default 30)")
    add_seed_argument(parser)
    parser.add_argument("--only", nargs="+", metavar="FAULT", help="inject these; `--only list` lists all")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/soak"), metavar="DIR")
    try:
        return run(parser.parse_args())
    except TactileLocalizerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def run(args: argparse.Namespace) -> int:
    """Run the soak; returns exit status 0 if nothing failed, otherwise 1."""
    if importlib.util.find_spec("rclpy") is None:
        raise LiveError("rclpy: expected ROS 2, found none; `make soak` makes an environment that has it")
    if not args.minutes > 0:
        raise ParameterError(f"--minutes: expected more than 0, got {args.minutes:g}")
    from harness.faults import FAULTS
    from harness.soak import SoakSettings, run_soak

    known = {fault.name: fault for fault in FAULTS}
    if args.only == ["list"]:
        print("\n".join(known))
        return 0
    for name in args.only or ():
        if name not in known:
            raise ParameterError(f"--only: expected some of {', '.join(known)}, got {name!r}")
    end_as_by_interrupt()
    console = Console(markup=False, emoji=False)
    faults = [known[name] for name in args.only or known]
    settings = SoakSettings(args.out, 60.0 * args.minutes, args.seed, faults)
    result = run_soak(settings, _PlainView(console))
    _report(result, args, console)
    return 1 if result.failures else 0


class _PlainView:
    """Prints one line per fault."""

    def __init__(self, console: Console) -> None:
        self._console, self._begun_s = console, time.monotonic()

    def phase(self, text: str) -> None:
        self._say(text)

    def injection(self, one: Injection) -> None:
        reported = "" if one.reported_s is None else f"reported after {one.reported_s:4.1f} s  "
        recovered = "" if one.recovered_s is None else f"recovered {one.recovered_s:4.1f} s after its end  "
        self._say(f"{one.fault:<28}{reported}{recovered}{one.trouble and 'FAILED: ' + one.trouble}")

    def _say(self, text: str) -> None:
        elapsed_s = time.monotonic() - self._begun_s
        self._console.print(f"{elapsed_s:7.1f} s  {text}", highlight=False, soft_wrap=True, markup=False)


def _report(result: SoakResult, args: argparse.Namespace, console: Console) -> None:
    """Print the tables, and write them with their data to the folder."""
    summary = _summary(result) | {"minutes": args.minutes, "seed": args.seed}
    write_json(args.out / "report.json", summary, rows="injections")
    with (args.out / "report.txt").open("w", encoding="utf-8") as file:
        for where in (console, Console(file=file, width=110, markup=False, emoji=False)):
            where.print(_of_faults(result.injections), _of_processes(result))
            for line in _sentences(result):
                where.print(line, highlight=False, soft_wrap=True, markup=False)
    console.print(f"written to {args.out}")


def _summary(result: SoakResult) -> dict[str, Any]:
    return {
        "failures": result.failures,
        "sweeps": result.sweeps,
        "posteriors": result.judged,
        "converged": result.converged,
        "converged_error_mm": _quantiles_mm(result.errors_m),
        "false_sweeps": result.false_sweeps,
        "falsely_converged": {why or "no fault": count for why, count in result.wrong.items()},
        "longest_lag_s": result.lag_s,
        "longest_wait_for_a_pose_s": result.waiting_s,
        "most_in_receive_queue_bytes": result.queue_bytes,
        "load": os.getloadavg(),
        "limits_extended": result.late,
        "memory_judged": result.is_warm,
        "recorded_pairs_after_warm_up": result.recorded_pairs,
        "memory": {
            name: {"after_warm_up": one.first_bytes, "end": one.last_bytes, "most": max(one.samples)}
            for name, one in result.memory.items()
        },
        "injections": [vars(one) for one in result.injections],
    }


def _quantiles_mm(errors_m: Sequence[float]) -> dict[str, float]:
    if not errors_m:
        return {}
    return {f"{100 * q:g} %": 1e3 * float(np.quantile(errors_m, q)) for q in (0.5, 0.95, 0.99, 1.0)}


def _of_faults(injections: Sequence[Injection]) -> Table:
    by_name: dict[str, list[Injection]] = defaultdict(list)
    for one in injections:
        by_name[one.fault].append(one)
    table = Table("fault", "times", "reported after (worst)", "recovered after (worst)", "failed", box=SIMPLE)
    for name, ones in sorted(by_name.items()):
        reported, recovered = (
            _worst([getattr(one, field) for one in ones]) for field in ("reported_s", "recovered_s")
        )
        table.add_row(
            name, str(len(ones)), reported, recovered, str(sum(bool(one.trouble) for one in ones) or "")
        )
    return table


def _worst(times_s: Sequence[float | None]) -> str:
    known = [time_s for time_s in times_s if time_s is not None]
    return f"{max(known):.1f} s" if known else "never"


def _of_processes(result: SoakResult) -> Table:
    since = "after warm-up" if result.is_warm else "at the start"
    table = Table("process", f"memory {since}", "at the end", "growth", "most", box=SIMPLE)
    for name, one in result.memory.items():
        numbers = (one.first_bytes, one.last_bytes, one.growth_bytes, max(one.samples))
        table.add_row(name, *(f"{number / 1e6:.1f} MB" for number in numbers))
    return table


def _sentences(result: SoakResult) -> list[str]:
    errors = ", ".join(f"{share}: {error:.1f} mm" for share, error in _quantiles_mm(result.errors_m).items())
    excused = sum(count for why, count in result.wrong.items() if why)
    lines = [
        f"load of the machine {os.getloadavg()[2]:.1f} on {os.cpu_count()} cores; "
        f"limits extended {result.late} times because a process waited for a CPU",
        f"{result.sweeps} sweeps, {result.judged} posteriors, {result.converged} converged ({errors})",
        f"falsely converged posteriors: {result.wrong.get('', 0)}, and {excused} with a fault that misleads",
        *(f"false convergence: {one}" for one in result.false_sweeps),
        f"longest lag without a fault {result.lag_s:.2f} s, longest wait for poses {result.waiting_s:.2f} s, "
        f"fullest receive queue {result.queue_bytes} bytes",
    ]
    if not result.is_warm:
        lines.append(
            "memory was not checked: the warm-up takes two rounds of all faults and two recorded sweeps"
        )
    return (
        lines
        + [f"FAILED: {failure}" for failure in result.failures or ()]
        + ([] if result.failures else ["nothing failed"])
    )


if __name__ == "__main__":
    raise SystemExit(main())
