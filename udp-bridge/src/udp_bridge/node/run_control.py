# SPDX-License-Identifier: Apache-2.0
"""What services do with a run's time, whatever they are called and answer in.

Rule: each returns when it is done and raises `CommandFailed` with a person's line when it can't be.
It knows no ROS; how wishes reach the simulator is `asking`'s.
"""

from __future__ import annotations

import time
from typing import Callable

from udp_bridge.wire.run_commands import ASK, PAUSE, PAUSED, RESET, RESUME, STEP, RunCommandReply

from .command_client import CommandFailed, RunCommandClient

MAX_TICKS = 10**9
POLL_S = 0.02
"""How often a run is asked whether its steps are done."""
STANDSTILL_S = 10.0
"""How long steps may make no progress: then somebody is waited for who does not come."""


def is_paused(run: RunCommandReply) -> bool:
    """Return whether sim time stands still."""
    return run.state == PAUSED


def describe(run: RunCommandReply) -> str:
    """Return how a run is, in words."""
    return f"{'paused' if is_paused(run) else 'running'} at tick {run.tick}"


class RunControl:
    """The simulator's run, as its gateway tells of it."""

    def __init__(self, asking: RunCommandClient, *, standstill_s: float = STANDSTILL_S) -> None:
        self._asking = asking
        self._standstill_s = standstill_s

    def state(self) -> RunCommandReply:
        """Return how it is."""
        return self._asking.ask(ASK)

    def pause(self) -> RunCommandReply:
        """Let sim time stand still."""
        return self._asking.ask(PAUSE)

    def resume(self) -> RunCommandReply:
        """Let sim time go on."""
        return self._asking.ask(RESUME)

    def reset(self) -> RunCommandReply:
        """Begin again at tick 0; a run that was paused is so still."""
        return self._asking.ask(RESET)

    def stop(self) -> RunCommandReply:
        """Begin again at tick 0, paused."""
        self.pause()
        return self.reset()

    def step(
        self, ticks: int, *, told: Callable[[int], object] = lambda done: None
    ) -> RunCommandReply:
        """Let a run that is paused do so many ticks; return when they are done.

        Parameters
        ----------
        ticks
            How many.
        told
            Called several times a second with how many are done. What it raises ends the waiting,
            not the steps.

        Raises
        ------
        CommandFailed
            When time runs, or steps are not done as asked.
        """
        if not 1 <= ticks <= MAX_TICKS:
            raise CommandFailed(f"{ticks} steps: expected 1 to {MAX_TICKS}")
        before = self.state()
        if not is_paused(before):
            raise CommandFailed(f"the run is not paused but {describe(before)}; pause it first")
        now = self._asking.ask(STEP, ticks)
        tick, since = before.tick, time.monotonic()
        while not is_paused(now) and now.tick <= before.tick + ticks:
            told(now.tick - before.tick)
            if now.tick != tick:
                tick, since = now.tick, time.monotonic()
            elif time.monotonic() - since > self._standstill_s:
                raise CommandFailed(
                    f"time has stood at tick {tick} for {self._standstill_s:g} s, with "
                    f"{before.tick + ticks - tick} steps to go: physics waits for somebody, "
                    "whom its output names"
                )
            time.sleep(POLL_S)
            now = self.state()
        if now.tick != before.tick + ticks or not is_paused(now):
            raise CommandFailed(f"somebody else meddled with the steps: the run is {describe(now)}")
        return now
