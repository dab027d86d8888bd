# SPDX-License-Identifier: Apache-2.0
"""Services and an action of `simulation_interfaces`, the ROS 2 standard for simulators.

Reported features follow the standard. Every other request is answered as unsupported, with one line
on the alternative. Importing this module requires that package.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)

from udp_bridge.node.command_client import CommandFailed
from udp_bridge.node.run_control import RunControl, is_paused
from udp_bridge.wire.run_commands import RunCommandReply

FEATURES = (
    SimulatorFeatures.SIMULATION_RESET,
    SimulatorFeatures.SIMULATION_RESET_TIME,
    SimulatorFeatures.SIMULATION_RESET_STATE,
    SimulatorFeatures.SIMULATION_STATE_GETTING,
    SimulatorFeatures.SIMULATION_STATE_SETTING,
    SimulatorFeatures.SIMULATION_STATE_PAUSE,
    SimulatorFeatures.STEP_SIMULATION_SINGLE,
    SimulatorFeatures.STEP_SIMULATION_MULTIPLE,
    SimulatorFeatures.STEP_SIMULATION_ACTION,
)
NOTE = (
    "A step is a tick of 2.5 ms. Time and state are reset together (scope 0, 3 or 255); what was "
    "put into the world while it ran stays in it."
)

_TOGETHER = ResetSimulation.Request.SCOPE_TIME | ResetSimulation.Request.SCOPE_STATE


def _result(code: int, message: str = "") -> Any:
    return Result(result=code, error_message=message)


class _Cancelled(Exception):
    """The client canceled the steps."""


class StandardServices:
    """Request handlers; each fills and returns a response, in any thread."""

    def __init__(self, run: RunControl) -> None:
        self._run = run
        self._is_stopped = False
        """Whether the last request was to stop. A stopped run is a paused run that was reset, so
        the run itself does not reveal the difference."""

    def rows(self) -> list[tuple[str, Any, Callable[[Any, Any], Any]]]:
        """Return name, type and callback of each service."""
        return [
            ("get_simulator_features", GetSimulatorFeatures, self.features),
            ("get_simulation_state", GetSimulationState, self.state),
            ("set_simulation_state", SetSimulationState, self.set_state),
            ("step_simulation", StepSimulation, self.step),
            ("reset_simulation", ResetSimulation, self.reset),
        ]

    def actions(self) -> list[tuple[str, Any, Callable[[Any], Any]]]:
        """Return name, type and callback of each action."""
        return [("simulate_steps", SimulateSteps, self.simulate)]

    def features(self, _: Any, response: Any) -> Any:
        """Return the supported features."""
        response.features = SimulatorFeatures(features=list(FEATURES), custom_info=NOTE)
        return response

    def state(self, _: Any, response: Any) -> Any:
        """Return whether time runs."""

        def do() -> Any:
            response.state.state = self._state(self._run.state())
            return _result(Result.RESULT_OK)

        response.result = _done(do)
        return response

    def set_state(self, request: Any, response: Any) -> Any:
        """Run, pause or stop the simulation."""
        wanted = request.state.state
        ways = {
            SimulationState.STATE_PLAYING: self._run.resume,
            SimulationState.STATE_PAUSED: self._run.pause,
            SimulationState.STATE_STOPPED: self._run.stop,
        }

        def do() -> Any:
            if wanted not in ways:
                return _result(
                    Result.RESULT_FEATURE_UNSUPPORTED,
                    f"state {wanted} can't be set, only 0 (stopped), 1 (playing) and 2 (paused); "
                    "a run is ended where it was started",
                )
            if self._state(self._run.state()) == wanted:
                return _result(SetSimulationState.Response.ALREADY_IN_TARGET_STATE)
            ways[wanted]()
            self._is_stopped = wanted == SimulationState.STATE_STOPPED
            return _result(Result.RESULT_OK)

        response.result = _done(do)
        return response

    def step(self, request: Any, response: Any) -> Any:
        """Advance time by some ticks; return when they are done."""

        def do() -> Any:
            self._run.step(request.steps)
            return _result(Result.RESULT_OK)

        response.result = _done(do)
        return response

    def simulate(self, goal: Any) -> Any:
        """Step with progress feedback; canceling pauses the run at once."""
        steps = goal.request.steps

        def report(done: int) -> None:
            if goal.is_cancel_requested:
                raise _Cancelled
            goal.publish_feedback(
                SimulateSteps.Feedback(completed_steps=done, remaining_steps=steps - done)
            )

        def do() -> Any:
            try:
                self._run.step(steps, on_progress=report)
            except _Cancelled:
                self._run.pause()
                goal.canceled()
                return _result(Result.RESULT_OPERATION_FAILED, "cancelled; the run is paused")
            goal.succeed()
            return _result(Result.RESULT_OK)

        result = _done(do)
        if goal.is_active:
            goal.abort()
        return SimulateSteps.Result(result=result)

    def reset(self, request: Any, response: Any) -> Any:
        """Restart the run."""
        scope = request.scope or ResetSimulation.Request.SCOPE_ALL

        def do() -> Any:
            if scope not in (_TOGETHER, ResetSimulation.Request.SCOPE_ALL):
                return _result(Result.RESULT_FEATURE_UNSUPPORTED, f"scope {scope}: {NOTE}")
            self._run.reset()
            return _result(Result.RESULT_OK)

        response.result = _done(do)
        return response

    def _state(self, run: RunCommandReply) -> int:
        if not is_paused(run):
            self._is_stopped = False
            return int(SimulationState.STATE_PLAYING)
        if self._is_stopped and run.tick <= 0:
            return int(SimulationState.STATE_STOPPED)
        return int(SimulationState.STATE_PAUSED)


def _done(do: Callable[[], Any]) -> Any:
    """Return the result of a call, or the reason for its failure."""
    try:
        return do()
    except CommandFailed as reason:
        return _result(Result.RESULT_OPERATION_FAILED, str(reason))
