"""A task of an evaluation that takes no time, for tests of what runs tasks."""

from __future__ import annotations

import random
from typing import Any

from evaluation.jobs import Task


def drawn(seed: int) -> dict[str, Any]:
    """A number that depends on the seed; fails if that is negative."""
    if seed < 0:
        raise ValueError(f"seed {seed}: expected at least 0")
    return {"number": random.Random(seed).random()}


def quick_task(seed: int) -> Task:
    """The task of :func:`drawn`."""
    return Task(drawn, (seed,), {"seed": seed})
