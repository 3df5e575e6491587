"""Where the files that come with the package are: scenes, parameters, CAN databases, messages."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = Path(__file__).parent
"""The directory of this Python package; its parent is the source tree, if it is not installed."""


def resource_path(relative: str | Path) -> Path:
    """Path of a file that comes with the package.

    Looked for in the source tree, in an installed wheel and in the share directories of ROS, in this order.

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
