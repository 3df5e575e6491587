"""Search for columns that may have the numbers of the sweeps."""

from pathlib import Path

from tactile_localizer.io.csv.columns import ColumnNaming
from tactile_localizer.io.csv.rows import NUMBER, cells_of, read_rows
from tactile_localizer.scene import Scene

_SHORTEST = 10
"""Mean number of rows of a sweep below which a column of numbers counts rows, or is a flag (judgement)."""


def sweep_columns(path: Path, scene: Scene, naming: ColumnNaming) -> list[str]:
    """Columns without a meaning whose whole numbers are constant over stretches, each number over one.

    Parameters
    ----------
    path : CSV file with the strain
    scene, naming : of the columns with a meaning

    Raises
    ------
    ScanError
        The file cannot be read.
    """
    strains = [name for each in scene.phalanges for name in naming.of(each.name, each.channels).names]
    named = [name for columns in naming.columns.values() for name in columns.names]
    header, blocks = read_rows(path, [*naming.of("stamp_s").names, *strains])
    known = {header.place(name) for name in ("stamp_s", *scene.axis_names, *strains, *named)}
    stretches: dict[int, list[str]] = {
        place: [] for place, name in enumerate(header.names) if name and place not in known
    }
    rows = 0
    for block in blocks:
        for text in block.rows().values():
            cells, rows = [cell.strip() for cell in cells_of(text, header.separator)], rows + 1
            for place, found in list(stretches.items()):
                cell = cells[place] if place < len(cells) else ""
                if found[-1:] == [cell]:
                    continue
                is_whole = NUMBER.fullmatch(cell) and float(cell.replace(",", ".")) % 1 == 0
                found.append(cell)
                if not is_whole or cell in found[:-1] or len(found) * _SHORTEST > rows + 100 * _SHORTEST:
                    del stretches[place]
    return [header.names[place] for place, found in stretches.items() if 1 < len(found) <= rows / _SHORTEST]
