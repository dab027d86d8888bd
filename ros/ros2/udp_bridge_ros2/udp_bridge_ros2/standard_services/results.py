# SPDX-License-Identifier: Apache-2.0
"""Results of the standard's services: a code and one line of text."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from simulation_interfaces.msg import Result

from udp_bridge.node.command_client import CommandFailed

from .request_refused import RequestRefused

ServiceHandler = Callable[[Any, Any], str | None]
"""Fills a response for a request. Returns a text to go with success, or raises `RequestRefused`."""


def outcome(response_class: type, do: Callable[[], str | None]) -> Any:
    """Call a function and return the Result of it.

    Codes above 100 are constants of the response's class. A class of an older version may lack one:
    the operation then failed, without a closer reason.
    """
    try:
        return Result(result=Result.RESULT_OK, error_message=do() or "")
    except RequestRefused as refused:
        constant, reason = refused.constant, str(refused)
    except CommandFailed as failed:
        constant, reason = "RESULT_OPERATION_FAILED", str(failed)
    owner = next((row for row in (response_class, Result) if hasattr(row, constant)), None)
    code = getattr(owner, constant) if owner else Result.RESULT_OPERATION_FAILED
    return Result(result=code, error_message=reason)


def service_callback(handler: ServiceHandler) -> Callable[[Any, Any], Any]:
    """Return a callback for rclpy, which sets the response's `result`."""

    def callback(request: Any, response: Any) -> Any:
        response.result = outcome(type(response), partial(handler, request, response))
        return response

    return callback
