"""Long computations in a thread, while the executor of the node keeps running."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.task import Future

from tactile_localizer.ros.base.exception_guards import one_line

T = TypeVar("T")


async def run_in_thread(node: Node, work: Callable[[], T]) -> T:
    """Await ``work()``, run in a thread, from a callback or task of the node's executor.

    The callback group of the caller must be reentrant: the other callbacks of a mutually exclusive group
    would wait for the result.

    Raises
    ------
    Exception
        Whatever ``work`` raises.
    """
    future = Future(executor=node.executor)
    # Scheduling a done callback wakes the executor, which then resumes the awaiting coroutine.
    future.add_done_callback(lambda done: None)

    def run() -> None:
        try:
            result = work()
        except Exception as error:
            finish(future.set_exception, error)
        else:
            finish(future.set_result, result)

    def finish(set_outcome: Callable[[Any], None], outcome: Any) -> None:
        try:
            set_outcome(outcome)
        except Exception:  # from rclpy, if the executor was shut down in the meantime
            if node.context.ok():
                raise

    threading.Thread(target=run, name=f"{node.get_name()}: background", daemon=True).start()
    result: T = await future
    return result


class BackgroundJob:
    """A computation in a thread, at most one at a time, whose result is handled in the executor.

    Parameters
    ----------
    node : node whose executor handles the result
    name : name of the computation in the log
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name = node, name
        self.is_running = False

    def start(
        self,
        work: Callable[[], T],
        on_result: Callable[[T], None],
        on_error: Callable[[str], None] = lambda reason: None,
    ) -> None:
        """Run ``work`` in a thread, then ``on_result`` in the executor.

        Without effect while a computation is running, or if the node has no executor. An exception in
        either function is logged as a warning and passed to ``on_error`` as one line.
        """
        executor = self._node.executor
        if self.is_running or executor is None:
            return
        self.is_running = True

        async def run() -> None:
            try:
                on_result(await run_in_thread(self._node, work))
            except Exception as error:
                if self._node.context.ok():
                    self._node.get_logger().warning(f"{self._name}: {one_line(error)}")
                    on_error(one_line(error))
            finally:
                self.is_running = False

        executor.create_task(run)
