"""Guards around callbacks: no message, service request or timer terminates the process.

A callback handles the failures that it expects (:class:`TactileLocalizerError`) itself. Any other exception
is caught here and logged in one line; a message is dropped, and a service request is rejected.
"""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from rclpy.exceptions import ParameterException
from rclpy.node import Node

from tactile_localizer.errors import TactileLocalizerError, located, printable

_LOG_PERIOD_S = 1.0


def one_line(error: BaseException) -> str:
    """The text of an error in one line; for an unexpected type of error also the type and the location."""
    if isinstance(error, ParameterException):  # from rclpy, which surrounds the reason with other text
        text, _, name = str(error).rpartition(": ")
        return printable(f"parameter {name}: {text.partition('Reason: ')[2] or text}")
    return str(error) if isinstance(error, TactileLocalizerError) else f"unexpected {located(error)}"


def guard_callback(node: Node, name: str, callback: Callable[..., None]) -> Callable[..., None]:
    """The callback of the topic or timer ``name``, changed to log exceptions instead of raising them."""

    @wraps(callback)
    def guarded(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:
            _log(node, name, error)

    return guarded


def guard_service(
    node: Node, name: str, service_type: Any, callback: Callable[[Any, Any], Any]
) -> Callable[[Any, Any], Any]:
    """The callback of the service ``name``, changed to reject a request instead of raising an exception.

    The rejection is a default response (``success`` is false) with the reason in its field ``message``, if
    it has one. The callback may be a coroutine.
    """

    @wraps(callback)
    async def guarded(request: Any, response: Any) -> Any:
        try:
            answer = callback(request, response)
            return await answer if inspect.isawaitable(answer) else answer
        except Exception as error:
            _log(node, name, error)
            rejection = service_type.Response()
            if hasattr(rejection, "message"):
                rejection.message = one_line(error)
            return rejection

    return guarded


def _log(node: Node, name: str, error: Exception) -> None:
    node.get_logger().error(f"{name}: {one_line(error)}", throttle_duration_sec=_LOG_PERIOD_S)
