# SPDX-License-Identifier: Apache-2.0
"""State of the simulation: each transition, and what stands or goes on in each state.

STATE_QUITTING is never set: the simulator is left running.
"""

import pytest
from simulation_interfaces.msg import SimulationState
from simulation_interfaces.srv import SetSimulationState

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail
from simulation_interfaces_tck.scene import (
    ALREADY,
    OK,
    PAUSED,
    PLAYING,
    STATES,
    STOPPED,
    SimulatorScene,
)

INCORRECT = SetSimulationState.Response.INCORRECT_TRANSITION

TRANSITIONS = [
    (STOPPED, PLAYING),
    (PLAYING, STOPPED),
    (PLAYING, PAUSED),
    (PAUSED, PLAYING),
    (PAUSED, STOPPED),
]


def _id(state: int) -> str:
    return STATES[state].removeprefix("STATE_").lower()


def _needs_pause(scene: SimulatorScene, *states: int) -> None:
    if PAUSED in states:
        scene.simulator.need("SIMULATION_STATE_PAUSE")


@clause("GetSimulationState.srv: state", "SIMULATION_STATE_GETTING")
def test_state_is_one_of_the_standard(scene: SimulatorScene) -> None:
    """The state is one of the constants, and not that of a simulator that has quit."""
    state = scene.state()
    if state not in STATES or state == SimulationState.STATE_QUITTING:
        fail(f"GetSimulationState: expected a state of {STATES}, got {state}")


@pytest.mark.parametrize(("before", "after"), TRANSITIONS, ids=_id)
@clause("SimulationState.msg: description of each state", "SIMULATION_STATE_SETTING")
def test_transition_succeeds(scene: SimulatorScene, before: int, after: int) -> None:
    """A correct transition succeeds, and its target is then the state."""
    _needs_pause(scene, before, after)
    scene.bring_to(before)
    scene.set_state(after, OK)
    scene.must_be(after)


@clause(
    "SimulationState.msg: STATE_STOPPED; SetSimulationState.srv: INCORRECT_TRANSITION",
    "SIMULATION_STATE_PAUSE",
)
def test_stopped_simulation_is_paused_or_stays_stopped(scene: SimulatorScene) -> None:
    """Pausing from STOPPED, on which the standard differs, does what its result says."""
    scene.bring_to(STOPPED)
    wanted = SimulationState(state=PAUSED)
    response = scene.simulator.expect((OK, INCORRECT), SetSimulationState, state=wanted)
    scene.must_be(PAUSED if response.result.result == OK else STOPPED)


@clause("SimulationState.msg: STATE_STOPPED", "SIMULATION_STATE_PAUSE")
def test_stopped_simulation_is_paused_without_a_tick(scene: SimulatorScene) -> None:
    """From STOPPED to PAUSED, the simulated clock does not tick."""
    scene.bring_to(STOPPED)
    before = scene.simulator.clock_nanos()
    scene.set_state(PAUSED, OK, INCORRECT)
    if (after := scene.simulator.clock_nanos()) != before:
        fail(f"/clock: expected {before} ns as in STATE_STOPPED, got {after} ns")


@pytest.mark.parametrize("state", [STOPPED, PLAYING, PAUSED], ids=_id)
@clause("SetSimulationState.srv: ALREADY_IN_TARGET_STATE", "SIMULATION_STATE_SETTING")
def test_state_is_set_once(scene: SimulatorScene, state: int) -> None:
    """Setting the state that the simulation has is told apart from a transition."""
    _needs_pause(scene, state)
    scene.bring_to(state)
    scene.set_state(state, ALREADY)
    scene.must_be(state)


@pytest.mark.parametrize(
    "state", [SimulationState.STATE_NO_WORLD, SimulationState.STATE_LOADING_WORLD], ids=_id
)
@clause("SimulationState.msg: description of the state", "SIMULATION_STATE_SETTING")
def test_state_of_worlds_is_not_set(scene: SimulatorScene, state: int) -> None:
    """States that loading and unloading a world have are no targets."""
    scene.bring_to(PLAYING)
    response = scene.simulator.call(SetSimulationState, state=SimulationState(state=state))
    if response.result.result == OK:
        fail(f"SetSimulationState: expected {STATES[state]} to be refused, got RESULT_OK")
    scene.must_be(PLAYING)


@clause("SimulationState.msg: STATE_STOPPED", "SIMULATION_STATE_SETTING", needs=["SPAWNING"])
def test_stopping_removes_what_was_spawned(scene: SimulatorScene) -> None:
    """To stop is to pause and to reset all: spawned entities are gone."""
    scene.bring_to(PLAYING)
    name = scene.spawn()
    scene.set_state(STOPPED, OK)
    scene.must_lack(name)


@clause("SimulationState.msg: STATE_PLAYING", "SIMULATION_STATE_SETTING")
def test_time_goes_on_while_playing(scene: SimulatorScene) -> None:
    """The simulated clock ticks while the simulation plays."""
    scene.bring_to(STOPPED)
    scene.simulator.clock_nanos()
    scene.set_state(PLAYING, OK)
    if not scene.simulator.clock_goes_on():
        fail("/clock: expected it to go on in STATE_PLAYING, but it stands")


@clause("SimulationState.msg: STATE_PAUSED", "SIMULATION_STATE_PAUSE")
def test_time_stands_while_paused(scene: SimulatorScene) -> None:
    """The simulated clock does not tick while the simulation is paused."""
    scene.bring_to(PLAYING)
    scene.set_state(PAUSED, OK)
    scene.simulator.clock_nanos()
    if scene.simulator.clock_goes_on():
        fail("/clock: expected it to stand in STATE_PAUSED, but it goes on")
