"""The mutants of ``make mutants`` match the code."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
FAULTS = runpy.run_path(str(ROOT / "test" / "mutants.py"))["faults"]()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.module}: {fault.name}")
def test_a_mutant_changes_one_place_and_stays_valid(fault: Any) -> None:
    compile(fault.seeded((ROOT / fault.path).read_text()), fault.path, "exec")


def test_mutants_have_unique_names() -> None:
    text = (ROOT / "test" / "mutants.txt").read_text()
    named = [(fault.module, fault.name) for fault in FAULTS]
    assert len(set(named)) == len(named) == text.count("\n- ") == text.count("\n+") > 50
