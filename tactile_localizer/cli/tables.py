"""Printing of tables to the terminal."""

from collections.abc import Sequence


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows of texts under column headings; columns of numbers are aligned to the right."""
    aligned = []
    for heading, *cells in zip(columns, *rows, strict=True):
        is_number = all(cell[:1] in "+-0123456789" for cell in cells)
        width = max(map(len, (heading, *cells)))
        aligned.append([f"{cell:{'>' if is_number else '<'}{width}}" for cell in (heading, *cells)])
    for row in zip(*aligned, strict=True):
        print("  ".join(row).rstrip())
