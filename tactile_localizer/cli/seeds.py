"""The option ``--seed``."""

from __future__ import annotations

import argparse


def add_seed_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--seed``."""
    parser.add_argument("--seed", type=_seed, default=1, help="random seed (default 1)")


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a non-negative integer, got {text}")
    return int(text)
