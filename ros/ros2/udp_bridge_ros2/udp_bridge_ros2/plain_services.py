# SPDX-License-Identifier: Apache-2.0
"""Services of std_srvs for a ROS that has no `simulation_interfaces`: each a Trigger.

Rule: `success` says whether it was done, `message` how the run is then, or why not. Importing this
needs std_srvs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from udp_bridge.wishing import WishAnswer

from .asking import Unable
from .run import Run, describe


class PlainServices:
    """Answers requests, from any thread.

    Parameters
    ----------
    step_ticks
        Returns how many ticks `step` does: a Trigger has no room for a number.
    """

    def __init__(self, run: Run, step_ticks: Callable[[], int]) -> None:
        self._run = run
        self._step_ticks = step_ticks

    def rows(self) -> list[tuple[str, Any, Callable[[Any, Any], Any]]]:
        """Return name, type and callback of each service."""
        run = self._run
        ways: dict[str, Callable[[], WishAnswer]] = {
            "state": run.state,
            "pause": run.pause,
            "resume": run.resume,
            "step": lambda: run.step(self._step_ticks()),
            "reset": run.reset,
        }
        return [(name, Trigger, partial(_answer, way)) for name, way in ways.items()]


def _answer(way: Callable[[], WishAnswer], _: Any, response: Any) -> Any:
    try:
        response.message = describe(way())
        response.success = True
    except Unable as reason:
        response.message = str(reason)
    return response
