"""Main function of the executables: runs a node until the process is asked to end."""

import gc
import logging
import signal
from collections.abc import Callable, Mapping, Sequence
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from tactile_localizer.ros.base.exception_guards import one_line
from tactile_localizer.ros.base.managed_node import ManagedNode

_WAKE_PERIOD_S = 0.2

REJECTED = 2
"""Exit status for an invalid command line or configuration: starting the node again would fail again."""


def run(make: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM.

    A signal ends spinning after the running callback. The handlers of rclpy would shut down the context of
    the node at any moment, also while it publishes or releases its resources.

    Parameters
    ----------
    make : constructs the node after rclpy is initialised
    args : command line; ``None`` for that of the process

    Returns
    -------
    int
        Exit status: 0, or :data:`REJECTED` if the node could not be constructed or autostarted.
    """
    received: dict[int, FrameType | None] = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        # Python code would be interrupted by the next signal, and that by the next; setdefault is not.
        signal.signal(number, received.setdefault)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make()
    except Exception as error:
        of_rclpy = " ".join(f"command line: {error}".split())  # an argument, or a parameter's value
        reason = one_line(error) if rclpy.ok() else of_rclpy
        rclpy.logging.get_logger("tactile_localizer").error(reason)
        rclpy.try_shutdown()
        return REJECTED
    logging.getLogger("tactile_localizer").addHandler(_ToRos(node))
    try:
        return _spin(node, received)
    finally:
        # Ctrl-C reaches a launched node twice, from the terminal and from launch; the second would kill it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        node.close()
        node.destroy_node()
        rclpy.shutdown()


class _ToRos(logging.Handler):
    """Makes warnings of the package, such as of files that are not used, warnings of a node."""

    def __init__(self, node: ManagedNode) -> None:
        super().__init__(logging.WARNING)
        self._log = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        self._log.warning(record.getMessage())


def _spin(node: ManagedNode, received: Mapping[int, FrameType | None]) -> int:
    """Start a node and run its callbacks until a signal is received; returns the exit status."""
    with SingleThreadedExecutor() as executor:
        executor.add_node(node)
        # A signal does not end a wait of the executor; Python handles it when the executor wakes up.
        node.create_timer(_WAKE_PERIOD_S, lambda: None)
        if node.parameters["autostart"]:
            started = executor.create_task(node.start)
            while not (started.done() or received):
                executor.spin_once()
            if started.done() and not started.result():
                return REJECTED
        # Exclude the existing objects from garbage collection, which would pause the node for 50 ms.
        gc.collect()
        gc.freeze()
        while not received:
            executor.spin_once()
    return 0
