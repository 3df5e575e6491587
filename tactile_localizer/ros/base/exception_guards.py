"""The boundary between a node and what it receives: no message, request or timer ends the process.

What a callback expects to go wrong it refuses by itself, with a :class:`TactileLocalizerError`. Anything else
that it raises is caught here: a service answers with a refusal, a message is dropped, and one line is logged.
"""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

from rclpy.node import Node

from tactile_localizer.errors import TactileLocalizerError

_LONGEST = 300
_LOG_PERIOD_S = 1.0


def in_one_line(error: BaseException) -> str:
    """What went wrong, and where, if it is not an error that the package raises on purpose."""
    if isinstance(error, TactileLocalizerError):
        return str(error)
    text = " ".join(str(error).split())[:_LONGEST]
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"unexpected {type(error).__name__}: {text}{place}"


def dropping(node: Node, name: str, work: Callable[..., None]) -> Callable[..., None]:
    """``work``, the callback of the topic or timer ``name``, that logs what goes wrong and goes on."""

    @wraps(work)
    def guarded(*arguments: Any) -> None:
        try:
            work(*arguments)
        except Exception as error:
            _report(node, name, error)

    return guarded


def refusing(
    node: Node, name: str, kind: Any, answer: Callable[[Any, Any], Any]
) -> Callable[[Any, Any], Any]:
    """``answer``, the callback of the service ``name`` of type ``kind``, that refuses when it fails.

    The refusal is a response as it is made: ``success`` is false where there is such a field, and ``message``
    has the reason. A coroutine is guarded as one.
    """

    def refused(error: Exception) -> Any:
        _report(node, name, error)
        refusal = kind.Response()
        if hasattr(refusal, "message"):
            refusal.message = in_one_line(error)
        return refusal

    @wraps(answer)
    def guarded(request: Any, response: Any) -> Any:
        try:
            return answer(request, response)
        except Exception as error:
            return refused(error)

    @wraps(answer)
    async def awaited(request: Any, response: Any) -> Any:
        try:
            return await answer(request, response)
        except Exception as error:
            return refused(error)

    return awaited if inspect.iscoroutinefunction(answer) else guarded


def _report(node: Node, name: str, error: Exception) -> None:
    if not node.context.ok():  # the process is about to end, and nothing can be published any more
        raise error
    node.get_logger().error(f"{name}: {in_one_line(error)}", throttle_duration_sec=_LOG_PERIOD_S)
