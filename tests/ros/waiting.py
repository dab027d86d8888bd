# SPDX-License-Identifier: Apache-2.0
"""Waiting for conditions of the test's own process."""

import time
from collections.abc import Callable
from typing import Any

from .processes import TIMEOUT_S


def wait_until(is_enough: Callable[[], Any], what: str = "what is waited for") -> None:
    """Wait for a condition, or fail naming it."""
    end = time.monotonic() + TIMEOUT_S
    while not is_enough():
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.001)


def each_period(period_s: float, count: int) -> Any:
    """Yield 0, 1, ... at a steady rate; one that is late is not waited for."""
    start = time.monotonic()
    for number in range(count):
        time.sleep(max(0.0, start + number * period_s - time.monotonic()))
        yield number
