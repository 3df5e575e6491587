"""Work that takes seconds, in a thread, while the node's executor goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from rclpy.node import Node
from rclpy.task import Future

T = TypeVar("T")


async def in_background(node: Node, work: Callable[[], T]) -> T:
    """The result of ``work``, or its exception; to be awaited in a callback or task of the node's executor.

    The callback's group must be reentrant: other callbacks of a mutually exclusive one would wait.
    """
    future = Future(executor=node.executor)
    future.add_done_callback(_wake_executor)

    def run() -> None:
        try:
            result = work()
        except Exception as error:
            future.set_exception(error)
        else:
            future.set_result(result)

    threading.Thread(target=run, name=f"{node.get_name()}: background", daemon=True).start()
    result: T = await future
    return result


def _wake_executor(future: Future) -> None:
    """Nothing: that a done callback is due wakes the executor, which then resumes who awaits."""
