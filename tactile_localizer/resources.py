"""Paths of the files that come with the package: scenes, parameters, CAN databases, messages."""

import os
from pathlib import Path

PACKAGE = Path(__file__).parent
"""Directory of this Python package; its parent is the source tree, unless it is installed."""


def resource_path(relative: str | Path) -> Path:
    """Path of a file that comes with the package.

    Searched are the source tree, an installed wheel and the share directories of ROS, in this order.

    Parameters
    ----------
    relative : path below the source tree, such as ``config/loadcells.dbc`` or ``msg/Posterior.msg``

    Raises
    ------
    FileNotFoundError
        No such file comes with the package.
    """
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    shares = [Path(prefix, "share", PACKAGE.name) for prefix in prefixes if prefix]
    places = [PACKAGE.parent, PACKAGE / "share", *shares]
    for place in places:
        path = place / relative
        if path.exists():
            return path
    raise FileNotFoundError(f"{relative}: expected in one of {', '.join(map(str, places))}, found in none")


def given_or_shipped(path: str | Path, folder: str) -> Path:
    """``path`` if it exists, otherwise the file of that name that comes with the package, if any.

    Parameters
    ----------
    path : only a plain name, such as ``linen.yaml``, is searched in the package
    folder : folder of such files in the package, such as ``config/scenes``
    """
    try:
        path = Path(path).expanduser()
        return path if path.parent != Path() or path.exists() else resource_path(Path(folder, path))
    except (OSError, RuntimeError):  # none is shipped, the name is too long, no such user
        return Path(path)
