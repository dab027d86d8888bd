# SPDX-License-Identifier: Apache-2.0
"""Simulation state, steps and reset."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import SimulationState
from simulation_interfaces.srv import ResetSimulation

from udp_bridge.node.command_client import CommandFailed
from udp_bridge.node.run_control import RunControl, is_paused

from .request_refused import RequestRefused
from .results import outcome
from .world_queries import WorldQueries

SCOPES = {
    ResetSimulation.Request.SCOPE_TIME: "time",
    ResetSimulation.Request.SCOPE_STATE: "state",
    ResetSimulation.Request.SCOPE_SPAWNED: "spawned",
}


WITHOUT_WORLD = {
    SimulationState.STATE_NO_WORLD: "no world is loaded. Fix: load one",
    SimulationState.STATE_LOADING_WORLD: "a world is being loaded. Fix: wait until that is done",
}
"""Why the simulation cannot be started, stopped, paused or stepped in these states."""


class _Canceled(Exception):
    """The client canceled the steps."""


class RunStateServices:
    """Handlers of requests for the state of the run; any thread may call them."""

    def __init__(self, run: RunControl, queries: WorldQueries) -> None:
        self._run = run
        self._queries = queries
        self._is_loading = False
        self._is_stopped = False
        """Whether the last request was to stop. A stopped run is a paused run that was reset, so
        the run itself does not reveal the difference."""

    def get_state(self, _: Any, response: Any) -> None:
        """Return whether time runs."""
        response.state.state = self._state()

    def set_state(self, request: Any, _: Any) -> None:
        """Run, pause or stop the simulation."""
        wanted = request.state.state
        transitions = {
            SimulationState.STATE_PLAYING: self._run.resume,
            SimulationState.STATE_PAUSED: self._run.pause,
            SimulationState.STATE_STOPPED: self._stop,
        }
        if wanted in WITHOUT_WORLD:
            raise RequestRefused(
                "INCORRECT_TRANSITION",
                f"state {wanted} can't be set, only 0 (stopped), 1 (playing) and 2 (paused)",
            )
        if wanted not in transitions:
            raise RequestRefused(
                "RESULT_FEATURE_UNSUPPORTED",
                f"state {wanted} can't be set, only 0 (stopped), 1 (playing) and 2 (paused); "
                "a run is ended where it was started",
            )
        try:
            present = self._state()
            if present == wanted:
                raise RequestRefused("ALREADY_IN_TARGET_STATE", f"the state is already {wanted}")
            if present in WITHOUT_WORLD:
                raise RequestRefused("INCORRECT_TRANSITION", WITHOUT_WORLD[present])
            transitions[wanted]()
        except CommandFailed as failed:
            raise RequestRefused("STATE_TRANSITION_ERROR", str(failed)) from None
        self._is_stopped = wanted == SimulationState.STATE_STOPPED

    def step(self, request: Any, _: Any) -> None:
        """Advance time by some ticks; return when they are done."""
        self._refuse_steps_if_stopped()
        self._run.step(request.steps)

    def simulate_steps(self, goal: Any) -> Any:
        """Step with feedback on each step; canceling pauses the run at once.

        The run reports its progress several times a second, so feedback comes in bursts.
        """
        steps = goal.request.steps
        reported = 0

        def report(done: int) -> None:
            nonlocal reported
            while reported < done:
                reported += 1
                goal.publish_feedback(
                    SimulateSteps.Feedback(
                        completed_steps=reported, remaining_steps=steps - reported
                    )
                )

        def report_unless_canceled(done: int) -> None:
            if goal.is_cancel_requested:
                raise _Canceled
            report(done)

        def do() -> None:
            self._refuse_steps_if_stopped()
            try:
                self._run.step(steps, on_progress=report_unless_canceled)
            except _Canceled:
                self._run.pause()
                goal.canceled()
                raise RequestRefused(
                    "RESULT_OPERATION_FAILED", "canceled; the run is paused"
                ) from None
            report(steps)
            goal.succeed()

        result = outcome(SimulateSteps.Result, do)
        if goal.is_active:
            goal.abort()
        return SimulateSteps.Result(result=result)

    def reset(self, request: Any, _: Any) -> None:
        """Reset time, state and spawned entities, or a part of them."""
        scope = request.scope or ResetSimulation.Request.SCOPE_ALL
        if scope != ResetSimulation.Request.SCOPE_ALL and scope & ~sum(SCOPES):
            raise RequestRefused(
                "RESULT_FEATURE_UNSUPPORTED",
                f"scope {scope}: expected a sum of 1 (time), 2 (state) and 4 (spawned), or 255",
            )
        self._queries.reset([name for bit, name in SCOPES.items() if scope & bit])

    @contextmanager
    def loading_world(self) -> Iterator[None]:
        """Report that a world is being loaded, which leaves the simulation stopped."""
        self._is_loading = True
        try:
            yield
            self._is_stopped = True
        finally:
            self._is_loading = False

    def _stop(self) -> None:
        self._run.pause()
        self._queries.reset(list(SCOPES.values()))

    def _state(self) -> int:
        if self._is_loading:
            return int(SimulationState.STATE_LOADING_WORLD)
        run = self._run.state()
        self._is_stopped = self._is_stopped and is_paused(run) and run.tick <= 0
        if not is_paused(run):
            return int(SimulationState.STATE_PLAYING)
        if run.tick <= 0 and not self._queries.has_world():
            return int(SimulationState.STATE_NO_WORLD)
        if self._is_stopped:
            return int(SimulationState.STATE_STOPPED)
        return int(SimulationState.STATE_PAUSED)

    def _refuse_steps_if_stopped(self) -> None:
        state = self._state()
        if state in WITHOUT_WORLD:
            raise RequestRefused("RESULT_INCORRECT_STATE", WITHOUT_WORLD[state])
        if state == SimulationState.STATE_STOPPED:
            raise CommandFailed("the simulation is stopped. Fix: pause it first")
