"""New scan files that appear under their names only when everything is in them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene


@contextmanager
def new_scan(path: str | Path, scene: Scene, *, strain_unit: str = "V") -> Iterator[ScanStore]:
    """A scan file to be filled: it becomes ``path`` when the block ends well, and is gone when it fails.

    Parameters
    ----------
    path : must not exist yet; its folder is made where there is none
    scene : kept in the file
    strain_unit : what the strain values are, for people

    Raises
    ------
    ScanError
        The file exists, or not all of it could be written.
    """
    path = Path(path)
    if path.exists():
        raise ScanError(f"{path}: expected no file of this name yet, found one; name another, or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise ScanError(f"{path}: expected a folder that can be written, {error.strerror}") from None
    with folder:
        unfinished = Path(folder.name, path.name)
        with ScanStore.create(unfinished, scene, strain_unit=strain_unit) as store:
            yield store
        # On a full disk SQLite keeps in its log what it could not put into the file.
        if Path(f"{unfinished}-wal").exists():
            raise ScanError(f"{path}: expected room for all of the scan, could write a part")
        unfinished.rename(path)
