"""Runs a node as a process."""

from __future__ import annotations

import gc
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from types import FrameType

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)

from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.ros.base.exception_guards import in_one_line
from tactile_localizer.ros.base.managed_node import ManagedNode

_WAKE_PERIOD_S = 0.5

REFUSED = 2
"""Exit status of a node that refuses its command line or its configuration: to start it again is no use."""


def run(make: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until Ctrl-C, SIGTERM or shutdown: the body of every executable.

    Parameters
    ----------
    make : makes the node, once rclpy is initialised
    args : command line; ``None``: that of the process

    Returns
    -------
    int
        Exit status: 0, or :data:`REFUSED` where the node could not be made, or refused to start by itself.
    """
    spinning = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        # rclpy, which has the signal first, ends the spin after the callback that runs: none is cut in two.
        if not spinning.is_set():
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        rclpy.init(args=args)
    except RuntimeError as error:  # the command line's own mistakes
        print(f"error: {str(error).splitlines()[0]}", file=sys.stderr)
        return REFUSED
    node = None
    try:
        node = _made(make)
        with _executor(node) as executor:
            executor.add_node(node)
            # rclpy wakes its executor for a signal before it shuts down: one that waits again would wait on.
            node.create_timer(_WAKE_PERIOD_S, _look_around, clock=Clock(clock_type=ClockType.STEADY_TIME))
            spinning.set()
            if node.parameters["autostart"] and not _started(node, executor):
                return REFUSED
            # What is there now stays: looking through it again for garbage would stop the stream for 50 ms.
            gc.collect()
            gc.freeze()
            executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except TactileLocalizerError as error:
        rclpy.logging.get_logger("tactile_localizer").error(str(error))
        return REFUSED
    except RuntimeError:  # rclpy's own, where a signal comes while it prepares to wait
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            node.close()
            node.destroy_node()
        _shut_down()
    return 0


def _made(make: Callable[[], ManagedNode]) -> ManagedNode:
    try:
        return make()
    except (KeyboardInterrupt, ExternalShutdownException, TactileLocalizerError):
        raise
    except Exception as error:  # rclpy's own, of parameters that it cannot take
        raise ParameterError(in_one_line(error)) from None


def _look_around() -> None:
    """Nothing: after each callback the executor sees whether rclpy is down."""


def _started(node: ManagedNode, executor: Executor) -> bool:
    """Whether the node has started by itself, or was interrupted before it could refuse to."""
    started = executor.create_task(node.start())
    executor.spin_until_future_complete(started)
    return bool(started.result()) if started.done() else True


def _shut_down() -> None:
    try:
        rclpy.try_shutdown()
    except RuntimeError:  # rclpy's own, where a signal shuts down at the same moment
        if rclpy.ok():
            raise


def _executor(node: ManagedNode) -> Executor:
    return MultiThreadedExecutor(node.threads) if node.threads > 1 else SingleThreadedExecutor()
