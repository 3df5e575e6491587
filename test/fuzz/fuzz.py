"""Fuzz the command line with mutated files: ``make fuzz MINUTES=10``.

Each case mutates one valid file, runs one command on it in a separate process, and asserts that it ends
within 10 s of processor time, with less than 1 GB of memory, with a result (status 0 or 1) or one line that
begins with ``error:`` (status 2), and without a traceback or a numpy warning; and that a scan file does not
load as a different map. Failing cases are kept in ``out/fuzz``, with the command to repeat them.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import math
import os
import random
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "lib"), str(Path(__file__).parent)]
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

from fuzz_targets import Target, map_of, write_good_files  # noqa: E402

from tactile_localizer import cli  # noqa: E402
from tactile_localizer.errors import TactileLocalizerError  # noqa: E402

MOST_SECONDS = 10
MOST_BYTES = 1_000_000_000
_MOST_WALL_SECONDS = 60
"""Elapsed time after which a process counts as hanging, also on a busy machine."""
_ADDRESS_SPACE = 8_000_000_000
_CRASHED, _DIFFERENT_MAP = 70, 71
_LONGEST_ERROR = 1000


def main() -> int:
    """Fuzz for the given time; the exit status is 1 if a case failed."""
    args = _arguments()
    until = time.monotonic() + 60.0 * args.minutes
    folder = Path(tempfile.mkdtemp(prefix="fuzz_"))
    good = folder / "good"
    good.mkdir()
    try:
        targets = [t for t in write_good_files(good) if not args.target or t.name in args.target]
        _warm_up()
        if args.case is not None:
            return _again(targets, args.case, good, folder)
        return _fuzz(targets, args, good, folder, until)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, help="number of cases of each kind, instead of minutes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first case")
    parser.add_argument("--target", action="append", help="fuzz this kind of file only (repeatable)")
    parser.add_argument("--case", type=int, help="run one case of a target and show its output")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="folder for failing cases")
    parser.add_argument("--most-failures", type=int, default=50)
    return parser.parse_args()


def _warm_up() -> None:
    """Import the modules of the commands once for all processes."""
    for name in ("import_", "scan", "replay"):
        __import__(f"tactile_localizer.cli.{name}")


def _fuzz(targets: list[Target], args: argparse.Namespace, good: Path, folder: Path, until: float) -> int:
    _require_good_files(targets, good, folder)
    seed = args.seed
    cases: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    failures = 0
    last = math.inf if args.rounds is None else args.seed + args.rounds
    while time.monotonic() < until and seed < last and failures < args.most_failures:
        for target in targets:
            with _case_folder(folder) as case:
                status, reason, command = _run_case(target, seed, good, case)
                cases[target.name] += 1
                refused[target.name] += status == 2
                if reason:
                    failures += 1
                    print(f"{target.name} case {seed}: {reason}\n    {command}", flush=True)
                    shutil.copytree(
                        case, args.out / f"{target.name.replace(' ', '_')}-{seed}", dirs_exist_ok=True
                    )
        seed += 1
    for name, count in cases.items():
        print(f"{name:18} {count:6} cases, {refused[name]:6} refused")
    print(f"{len(cases)} kinds, {sum(cases.values())} cases, {failures} failures")
    print("repeat a case: test/fuzz/fuzz.py --target NAME --case NUMBER")
    return 1 if failures else 0


def _again(targets: list[Target], seed: int, good: Path, folder: Path) -> int:
    (target,) = targets
    with _case_folder(folder) as case:
        status, reason, command = _run_case(target, seed, good, case)
        print(f"{command}\nstatus {status}: {reason or 'passed'}")
        for stream in ("stdout", "stderr"):
            print(f"--- {stream}\n{(case / stream).read_text(errors='replace')[-6000:]}")
    return 1 if reason else 0


def _require_good_files(targets: list[Target], good: Path, folder: Path) -> None:
    """Require that the files are read without mutation, so that refusals are due to the mutation."""
    for target in targets:
        with _case_folder(folder) as case:
            status, reason, command = _run_case(
                replace(target, mutate=lambda _, content: content), 0, good, case
            )
            if reason or status == 2:
                errors = (case / "stderr").read_text()
                raise SystemExit(f"{command}: expected to read a good file, {reason} {errors}")


@contextlib.contextmanager
def _case_folder(folder: Path) -> Iterator[Path]:
    case = folder / "case"
    (case / "OUT").mkdir(parents=True)
    try:
        yield case
    finally:
        shutil.rmtree(case, ignore_errors=True)


def _run_case(target: Target, seed: int, good: Path, case: Path) -> tuple[int, str, str]:
    """Exit status, failure (empty if none) and command line of one case."""
    rng = random.Random(f"{target.name} {seed}")
    content = target.mutate(rng, (good / target.file).read_bytes())
    mutated = _place(case, good, target.file)
    mutated.write_bytes(content)
    command = rng.choice(target.commands)
    is_part = "/" in target.file  # of a bag or a scan
    words = {"MUT": str(mutated.parent if is_part and rng.random() < 0.7 else mutated)}
    argv = [_word(part, words, good, case) for part in command.split()]
    status, used = _in_child(argv, target, mutated, case)
    return status, _judge(status, used, case), shlex.join(argv)


def _place(case: Path, good: Path, file: str) -> Path:
    """Path of the mutated file; a part of a bag or a scan is in a copy of it."""
    if "/" in file:
        shutil.copytree(good / Path(file).parent, case / Path(file).parent)
    return case / file


def _word(part: str, words: dict[str, str], good: Path, case: Path) -> str:
    if part in words:
        return words[part]
    if part.startswith("OUT"):
        return str(case / part)
    return str(good / part) if (good / part).exists() else part


def _in_child(
    argv: list[str], target: Target, mutated: Path, case: Path
) -> tuple[int, resource.struct_rusage]:
    child = os.fork()
    if child == 0:
        _become(case)
        os._exit(_work(argv, target, mutated))
    until = time.monotonic() + _MOST_WALL_SECONDS
    while True:
        found, status, used = os.wait4(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status), used
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            until = float("inf")
        time.sleep(0.005)


def _become(case: Path) -> None:
    """Limit the resources of this process and redirect its output to files."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = os.open(case / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(stream, number)
        os.close(stream)
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", errors="surrogateescape", closefd=False)
    sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False, buffering=1)
    faulthandler.enable(sys.stderr)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_BYTES, MOST_BYTES))


def _work(argv: list[str], target: Target, mutated: Path) -> int:
    try:
        if target.digests and not _is_same_map(target, mutated):
            return _DIFFERENT_MAP
        status = cli.main(argv)
        sys.stdout.flush()
        return status
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        return _CRASHED


def _is_same_map(target: Target, mutated: Path) -> bool:
    try:
        return map_of(mutated) in target.digests
    except TactileLocalizerError:
        return True


def _judge(status: int, used: resource.struct_rusage, case: Path) -> str:
    errors = (case / "stderr").read_text(encoding="utf-8", errors="replace")
    lines = [line for line in errors.splitlines() if line.strip()]
    if status == -signal.SIGXCPU or used.ru_utime + used.ru_stime > MOST_SECONDS:
        return f"took more than {MOST_SECONDS} s"
    if status == -signal.SIGKILL:
        return f"did not end within {_MOST_WALL_SECONDS} s"
    if 1024 * used.ru_maxrss > MOST_BYTES:
        return f"took {used.ru_maxrss / 1e6:.1f} GB"
    if status == _DIFFERENT_MAP:
        return "loaded as a different map"
    if status not in (0, 1, 2):
        return f"ended with status {status}: {lines[-1] if lines else ''}"
    if "Traceback" in errors or "Warning:" in errors:
        marked = [line for line in lines if "Warning:" in line]
        return f"printed {(marked or lines)[-1]}"
    if status == 2 and (len(lines) != 1 or not lines[0].startswith("error: ")):
        return f"expected one line that begins with error:, printed {lines[-3:]}"
    if status == 2 and len(lines[0]) > _LONGEST_ERROR:
        return f"an error of {len(lines[0])} characters: {lines[0][:100]}"
    return ""


if __name__ == "__main__":
    raise SystemExit(main())
