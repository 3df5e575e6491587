"""Compiled twins of numpy's loops over places and channels (``src/compiled.c``), where they were built.

A belief that has converged has some 200 places of a few numbers each, where calls of numpy cost ten times
what they compute. Without a compiler numpy does the same, and an update takes about twice as long.
"""

from importlib import import_module
from types import ModuleType


def _load() -> ModuleType | None:
    try:
        return import_module("tactile_localizer._compiled")
    except ImportError:
        return None


MODULE = _load()
"""``None``: not built."""
