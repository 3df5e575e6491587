"""Files that a command line names: one's own, or one of those that come with the package."""

from __future__ import annotations

from pathlib import Path

from tactile_localizer.resources import resource_path


def given_or_shipped(path: str | Path, folder: str) -> Path:
    """``path`` where it exists, else the file of that name that comes with the package, else ``path`` again.

    Parameters
    ----------
    path : as given; only a plain name, such as ``linen.yaml``, is looked for in the package
    folder : where the package keeps such files, such as ``config/scenes``
    """
    path = Path(path)
    if path.exists() or path.parent != Path("."):
        return path
    try:
        return resource_path(Path(folder, path))
    except FileNotFoundError:
        return path
