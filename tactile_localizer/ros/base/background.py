"""Long computations in a thread, while the executor of the node keeps running."""

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TypeVar

from rclpy.node import Node
from rclpy.task import Future

T = TypeVar("T")


async def run_in_thread(node: Node, work: Callable[[], T]) -> T:
    """Await ``work()``, run in a thread, from a callback or task of the node's executor.

    The other callbacks of a mutually exclusive callback group of the caller wait for the result.

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
            finish = partial(future.set_result, work())
        except Exception as error:
            finish = partial(future.set_exception, error)
        with suppress(Exception):  # from rclpy, if the executor was shut down in the meantime
            finish()

    threading.Thread(target=run, name=f"{node.get_name()}: background", daemon=True).start()
    return await future
