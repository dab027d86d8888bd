# SPDX-License-Identifier: Apache-2.0
"""Control of a run's time for ROS services: state, pause, resume, reset, stop and step.

Each call returns when its command is done, and raises `CommandFailed` with one line otherwise.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any, Callable, Dict

from udp_bridge.wire.run_commands import (
    PAUSE,
    PAUSED,
    QUERY,
    RESET,
    RESUME,
    STEP,
    RunCommandReply,
)

from .command_client import CommandFailed, RunCommandClient

MAX_TICKS = 10**9
POLL_S = 0.02
"""Time between two queries while steps are running."""
STANDSTILL_S = 10.0
"""How long steps may make no progress before the call fails."""


def is_paused(run: RunCommandReply) -> bool:
    """Return whether sim time is paused."""
    return run.state == PAUSED


def describe(run: RunCommandReply) -> str:
    """Return the state of a run in words."""
    return f"{'paused' if is_paused(run) else 'running'} at tick {run.tick}"


class RunControl:
    """The simulator's run, controlled through its gateway."""

    def __init__(self, client: RunCommandClient, *, standstill_s: float = STANDSTILL_S) -> None:
        self._client = client
        self._standstill_s = standstill_s

    def state(self) -> RunCommandReply:
        """Return the state and the tick."""
        return self._client.call(QUERY)

    def pause(self) -> RunCommandReply:
        """Pause sim time."""
        return self._client.call(PAUSE)

    def resume(self) -> RunCommandReply:
        """Resume sim time."""
        return self._client.call(RESUME)

    def reset(self) -> RunCommandReply:
        """Restart at tick 0; a paused run stays paused."""
        return self._client.call(RESET)

    def stop(self) -> RunCommandReply:
        """Restart at tick 0, paused."""
        self.pause()
        return self.reset()

    def step(
        self, ticks: int, *, on_progress: Callable[[int], object] = lambda done: None
    ) -> RunCommandReply:
        """Advance a paused run by some ticks; return when they are done.

        Parameters
        ----------
        ticks
            How many.
        on_progress
            Called several times a second with the ticks done so far. An exception that it raises
            ends the waiting, not the steps.

        Raises
        ------
        CommandFailed
            When the run is not paused, or the steps are not done as requested.
        """
        if not 1 <= ticks <= MAX_TICKS:
            raise CommandFailed(f"{ticks} steps: expected 1 to {MAX_TICKS}")
        before = self.state()
        if not is_paused(before):
            raise CommandFailed(
                f"the run is not paused but {describe(before)}. Fix: pause it first"
            )
        now = self._client.call(STEP, ticks)
        tick, since = before.tick, time.monotonic()
        while not is_paused(now) and now.tick <= before.tick + ticks:
            on_progress(now.tick - before.tick)
            if now.tick != tick:
                tick, since = now.tick, time.monotonic()
            elif time.monotonic() - since > self._standstill_s:
                raise CommandFailed(
                    f"time has stood at tick {tick} for {self._standstill_s:g} s, with "
                    f"{before.tick + ticks - tick} steps to go: physics waits for a process, "
                    "which its log names"
                )
            time.sleep(POLL_S)
            now = self.state()
        if now.tick != before.tick + ticks or not is_paused(now):
            raise CommandFailed(f"another client changed the run: it is {describe(now)}")
        return now


def triggers(run: RunControl, step_ticks: Callable[[], int]) -> Dict[str, Callable[[Any], Any]]:
    """Return callbacks of std_srvs/Trigger services by name, the same for ROS 1 and ROS 2.

    A callback fills a response and returns it: `success` says whether the command was executed,
    `message` the state of the run or the reason of the failure. Any thread may call it.

    Parameters
    ----------
    step_ticks
        Returns the ticks of one `step`: a Trigger has no field for a number.
    """
    calls: Dict[str, Callable[[], RunCommandReply]] = {
        "state": run.state,
        "pause": run.pause,
        "resume": run.resume,
        "step": lambda: run.step(step_ticks()),
        "reset": run.reset,
    }
    return {name: partial(_fill, call) for name, call in calls.items()}


def _fill(call: Callable[[], RunCommandReply], response: Any) -> Any:
    try:
        response.message = describe(call())
        response.success = True
    except CommandFailed as reason:
        response.message = str(reason)
    return response
