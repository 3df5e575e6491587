"""Main function of the executables: runs a node until the process is asked to end."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import FrameType

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor

from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.ros.base.exception_guards import one_line
from tactile_localizer.ros.base.managed_node import ManagedNode

_WAKE_PERIOD_S = 0.5

REJECTED = 2
"""Exit status for an invalid command line or configuration: starting the node again would fail again."""


def run(make: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT, SIGTERM or shutdown.

    Parameters
    ----------
    make : constructs the node after rclpy is initialised
    args : command line; ``None`` for that of the process

    Returns
    -------
    int
        Exit status: 0, or :data:`REJECTED` if the node could not be constructed or autostarted.
    """
    spinning = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        # The handler of rclpy runs first and ends spinning after the running callback; do not interrupt it.
        if not spinning.is_set():
            os._exit(0)  # nothing to release yet; an exception would end in a traceback

    signal.signal(signal.SIGINT, interrupt)
    try:
        rclpy.init(args=args)
    except RuntimeError as error:  # invalid arguments
        print(f"error: {str(error).splitlines()[0]}", file=sys.stderr)
        return REJECTED
    node = None
    try:
        node = _construct(make)
        with SingleThreadedExecutor() as executor:
            executor.add_node(node)
            # On a signal rclpy wakes the executor before it shuts down; an executor that waits again at that
            # moment misses the shutdown. After a timer callback it checks again.
            node.create_steady_timer(_WAKE_PERIOD_S, lambda: None)
            spinning.set()
            if node.parameters["autostart"] and not _autostart(node, executor):
                return REJECTED
            # Exclude the existing objects from garbage collection, which would pause the node for 50 ms.
            gc.collect()
            gc.freeze()
            executor.spin()
    except ExternalShutdownException:
        pass
    except TactileLocalizerError as error:
        rclpy.logging.get_logger("tactile_localizer").error(str(error))
        return REJECTED
    except RuntimeError:  # from rclpy, if a signal arrives while it prepares to wait
        if rclpy.ok():
            raise
    finally:
        # Ctrl-C reaches a launched node twice, from the terminal and from launch; the second would kill it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.close()
            node.destroy_node()
        with suppress(RuntimeError):  # from rclpy, if a signal shuts down at the same moment
            rclpy.try_shutdown()
    return 0


def _construct(make: Callable[[], ManagedNode]) -> ManagedNode:
    try:
        return make()
    except (ExternalShutdownException, TactileLocalizerError):
        raise
    except Exception as error:  # from rclpy, for invalid parameter overrides
        raise ParameterError(one_line(error)) from None


def _autostart(node: ManagedNode, executor: Executor) -> bool:
    """Whether autostart succeeded, or was interrupted before its result was known."""
    started = executor.create_task(node.start())
    executor.spin_until_future_complete(started)
    return bool(started.result()) if started.done() else True
