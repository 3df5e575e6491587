"""The faults of ``make mutants`` still fit the core that they are seeded into."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
FAULTS = runpy.run_path(str(ROOT / "test" / "mutants.py"))["faults"]()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.module}: {fault.name}")
def test_a_fault_changes_one_place_of_the_core_and_leaves_it_python(fault: Any) -> None:
    compile(fault.seeded((ROOT / fault.path).read_text()), fault.path, "exec")


def test_every_fault_of_the_list_is_understood_and_has_a_name_of_its_own() -> None:
    text = (ROOT / "test" / "mutants.txt").read_text()
    named = [(fault.module, fault.name) for fault in FAULTS]
    assert len(set(named)) == len(named) == text.count("\n- ") == text.count("\n+") > 50
