"""Base names of test files: launch_testing's pytest plugin imports the files by them."""

from collections import Counter
from pathlib import Path


def test_base_names_are_unique() -> None:
    counts = Counter(path.name for path in Path(__file__).parent.rglob("test_*.py"))
    assert [name for name, count in counts.items() if count > 1] == []
