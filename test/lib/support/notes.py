"""Numbers in the notes of a recording, which tests compare instead of the wording."""

import re
from collections.abc import Iterable


def counts(notes: Iterable[str]) -> list[tuple[int, int]]:
    """Skipped and total number in each note that has them, such as ``skipped 3 of 20 ...``."""
    found = (re.search(r"skipped (\d+) of (\d+)", note) for note in notes)
    return [(int(match[1]), int(match[2])) for match in found if match]
