"""Seeds known faults into a copy of the core, one at a time, and sees that a test fails for each.

A spot check of the tests, not a part of them: ``make mutants``. ``python test/mutants.py WORD...`` tries the
faults with these words in their line alone, and does not see first that the sound core passes.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
_PATIENCE_S = 900.0
COPIED = ("tactile_localizer", "test", "config", "msg", "pyproject.toml")


@dataclass(frozen=True)
class Fault:
    """One line made wrong.

    Parameters
    ----------
    name : what is wrong then
    module : of the core; its tests are tried first, then those of the whole core
    right, wrong : the text as it is, and what is put in its place
    """

    name: str
    module: str
    right: str
    wrong: str

    @property
    def path(self) -> Path:
        """Of the module in a tree."""
        return Path("tactile_localizer", "core", f"{self.module}.py")

    def seeded(self, sound: str) -> str:
        """The module's text with the fault in it.

        Raises
        ------
        ValueError
            The text to replace is not there, or more than once.
        """
        if (found := sound.count(self.right)) != 1:
            raise ValueError(f"{self.name}: expected {self.right!r} once in {self.path}, found {found}")
        return sound.replace(self.right, self.wrong)


def faults() -> list[Fault]:
    """Those of ``mutants.txt``."""
    text = (ROOT / "test" / "mutants.txt").read_text()
    return [
        Fault(name, module, right, wrong.strip())
        for module, name, right, wrong in re.findall(r"^([\w/]+): (.+)\n- (.+)\n\+(.*)$", text, re.MULTILINE)
    ]


def main(words: list[str]) -> int:
    """Try the faults; the exit status says whether all were caught."""
    chosen = [fault for fault in faults() if all(word in f"{fault.module}: {fault.name}" for word in words)]
    survived = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
        if not words and (failed := failing(copy, copy / "test" / "core")):
            raise SystemExit(f"the sound core: expected to pass its tests, failed {failed}")
        for fault in chosen:
            begun = time.monotonic()
            caught = seed(copy, fault)
            if not caught:
                survived.append(fault.name)
            print(f"{fault.name:46} {caught or 'SURVIVED':90} {time.monotonic() - begun:5.1f} s", flush=True)
    print(f"{len(chosen) - len(survived)} of {len(chosen)} faults caught")
    return 1 if survived else 0


def seed(copy: Path, fault: Fault) -> str:
    """The first test that fails with the fault in the copy; empty where none does."""
    path = copy / fault.path
    sound = path.read_text()
    path.write_text(fault.seeded(sound))
    try:
        own = next((copy / "test" / "core").rglob(f"test_{Path(fault.module).name}.py"), None)
        return (failing(copy, own) if own else "") or failing(copy, copy / "test" / "core")
    finally:
        path.write_text(sound)


def failing(copy: Path, tests: Path) -> str:
    """The first of the tests that fails; none where they do not end."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", str(tests)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    try:
        done = subprocess.run(
            command,
            cwd=copy,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=_PATIENCE_S,
        )
    except subprocess.TimeoutExpired:
        return ""
    found = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return found.group(1).removeprefix("test/core/") if found else ""


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
