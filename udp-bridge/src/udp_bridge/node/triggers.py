# SPDX-License-Identifier: Apache-2.0
"""Services that need no types of their own: what each Trigger of std_srvs does.

Rule: `success` says whether it was done, `message` how the run is then, or why not. Requests and
responses are ROS's, whose fields have the same names in ROS 1 and 2.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Callable, Dict

from udp_bridge.wire.run_commands import RunCommandReply

from .command_client import CommandFailed
from .run_control import RunControl, describe


def triggers(run: RunControl, step_ticks: Callable[[], int]) -> Dict[str, Callable[[Any], Any]]:
    """Return by name what fills a response, from any thread, and returns it.

    Parameters
    ----------
    step_ticks
        Returns how many ticks `step` does: a Trigger has no room for a number.
    """
    ways: Dict[str, Callable[[], RunCommandReply]] = {
        "state": run.state,
        "pause": run.pause,
        "resume": run.resume,
        "step": lambda: run.step(step_ticks()),
        "reset": run.reset,
    }
    return {name: partial(_answer, way) for name, way in ways.items()}


def _answer(way: Callable[[], RunCommandReply], response: Any) -> Any:
    try:
        response.message = describe(way())
        response.success = True
    except CommandFailed as reason:
        response.message = str(reason)
    return response
