"""``ros2 launch`` in tests."""

from collections.abc import Callable

from support.processes import Process

Launch = Callable[..., Process]
"""``launch("bringup", scan_file=...)`` runs ``ros2 launch`` of an installed launch file, or of a path."""
