# SPDX-License-Identifier: Apache-2.0
"""What services do with a run: steps that are done, interfered with, or stalled."""

import pytest

from udp_bridge.node.command_client import CommandFailed
from udp_bridge.node.run_control import RunControl
from udp_bridge.wire.run_commands import (
    PAUSE,
    PAUSED,
    QUERY,
    RESET,
    RESUME,
    RUNNING,
    STEP,
    RunCommandReply,
)


class Simulator:
    """A stand-in for `RunCommandClient`: the run advances some ticks between two queries."""

    def __init__(self, *, ticks_a_question: int = 3) -> None:
        self.tick, self.left = 100, 0
        self.is_running = False
        self.asked: list[int] = []
        self._pace = ticks_a_question

    def call(self, action: int, ticks: int = 0) -> RunCommandReply:
        self.asked.append(action)
        if action == STEP:
            self.left = ticks
        elif action in (PAUSE, RESUME):
            self.left, self.is_running = 0, action == RESUME
        elif action == RESET:
            self.tick = 0
        elif action == QUERY:
            self.tick += self._pace if self.is_running else min(self._pace, self.left)
            self.left = max(0, self.left - self._pace)
        return RunCommandReply(0, RUNNING if self.is_running or self.left else PAUSED, self.tick)


def run_of(simulator: Simulator) -> RunControl:
    return RunControl(simulator, standstill_s=0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize("ticks", [1, 3, 10])
def test_steps_are_done_when_it_returns(ticks: int) -> None:
    simulator = Simulator()
    told: list[int] = []
    assert run_of(simulator).step(ticks, on_progress=told.append).tick == 100 + ticks
    assert simulator.left == 0
    assert told == sorted(told)


def test_a_stopped_run_is_paused_before_it_is_reset() -> None:
    simulator = Simulator()
    assert run_of(simulator).stop().tick == 0
    assert simulator.asked == [PAUSE, RESET]


@pytest.mark.parametrize("ticks", [-1, 0, 10**9 + 1])
def test_steps_that_are_none(ticks: int) -> None:
    simulator = Simulator()
    with pytest.raises(CommandFailed, match=f"{ticks} steps: expected 1 to 1000000000"):
        run_of(simulator).step(ticks)
    assert STEP not in simulator.asked


def test_a_run_that_is_not_paused_is_not_stepped() -> None:
    simulator = Simulator()
    simulator.is_running = True
    with pytest.raises(CommandFailed, match=r"running at tick 103\. Fix: pause it first"):
        run_of(simulator).step(1)
    assert STEP not in simulator.asked


@pytest.mark.parametrize("action", [PAUSE, RESUME, RESET])
def test_somebody_else_meddles(action: int) -> None:
    simulator = Simulator()
    with pytest.raises(CommandFailed, match="another client changed the run: it is"):
        run_of(simulator).step(30, on_progress=lambda done: done > 9 and simulator.call(action))


def test_physics_is_stalled() -> None:
    simulator = Simulator(ticks_a_question=0)
    with pytest.raises(CommandFailed, match=r"stood at tick 100 for 0\.1 s, with 30 steps to go"):
        run_of(simulator).step(30)
