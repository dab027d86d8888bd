# SPDX-License-Identifier: Apache-2.0
"""Steps of a paused simulation, by the service and by the action."""

from typing import Any

from action_msgs.msg import GoalStatus
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result
from simulation_interfaces.srv import GetEntities, StepSimulation

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import SimulatorClient, fail, not_tested
from simulation_interfaces_tck.scene import OK, PAUSED, PLAYING, STOPPED, SimulatorScene

NOT_PAUSED = (Result.RESULT_OPERATION_FAILED, Result.RESULT_INCORRECT_STATE)
"""The standard names the first for steps; its description of the second has it as an example."""

STEPS = 5
MANY_STEPS = 1_000_000
"""So many that they are cancelled before they end."""


class Steps:
    """A goal of SimulateSteps, with its feedback."""

    def __init__(self, simulator: SimulatorClient, steps: int) -> None:
        self.simulator = simulator
        self.handle = simulator.wait_for(
            simulator.action().send_goal_async(SimulateSteps.Goal(steps=steps)),
            "SimulateSteps accepts or rejects the goal",
        )

    @property
    def feedback(self) -> list[tuple[int, int]]:
        """Completed and remaining steps of each feedback."""
        return self.simulator.feedback_of(self.handle)

    def end(self) -> Any:
        """Wait for the result, and for feedback that is still on its way; return the result."""
        if not self.handle.accepted:
            fail("SimulateSteps: expected the goal to be accepted, it was rejected")
        done = self.simulator.wait_for(self.handle.get_result_async(), "SimulateSteps ends")
        self.simulator.settle(lambda: len(self.feedback))
        return done

    def succeed(self) -> None:
        """Fail unless all steps are done."""
        done = self.end()
        self.simulator.check(OK, done.result.result, "SimulateSteps")
        if done.status != GoalStatus.STATUS_SUCCEEDED:
            fail(f"SimulateSteps: expected the status STATUS_SUCCEEDED (4), got {done.status}")


def _begun(scene: SimulatorScene) -> str:
    """Pause the simulation some time after its start; return an entity, if there is one."""
    scene.bring_to(PLAYING)
    names = scene.entities() if scene.simulator.serves(GetEntities) else []
    scene.simulator.spin(0.05)
    scene.bring_to(PAUSED)
    return names[0] if names else ""


def _step(scene: SimulatorScene, steps: int) -> None:
    if scene.simulator.serves(StepSimulation):
        scene.simulator.expect(OK, StepSimulation, steps=steps)
    else:
        Steps(scene.simulator, steps).succeed()


@clause("StepSimulation.srv: description", "STEP_SIMULATION_SINGLE")
def test_step_returns_to_paused(scene: SimulatorScene) -> None:
    """After a step the simulation is paused."""
    scene.bring_to(PAUSED)
    scene.simulator.expect(OK, StepSimulation, steps=1)
    scene.must_be(PAUSED)


@clause("StepSimulation.srv: steps", "STEP_SIMULATION_SINGLE")
def test_step_advances_time(scene: SimulatorScene) -> None:
    """A step advances the simulated time."""
    name = _begun(scene)
    before = scene.nanos(name)
    scene.simulator.expect(OK, StepSimulation, steps=1)
    if scene.nanos(name) <= before:
        fail(f"simulated time: expected more than {before} ns after a step, but it stands")


@clause("StepSimulation.srv: result; Result.msg: RESULT_INCORRECT_STATE", "STEP_SIMULATION_SINGLE")
def test_step_is_refused_while_playing(scene: SimulatorScene) -> None:
    """A simulation that is not paused is not stepped, and the error message says so."""
    scene.bring_to(PLAYING)
    response = scene.simulator.expect(NOT_PAUSED, StepSimulation, steps=1)
    if not response.result.error_message:
        fail("StepSimulation: expected an error_message, got none")
    scene.must_be(PLAYING)


@clause("StepSimulation.srv: result; Result.msg: RESULT_INCORRECT_STATE", "STEP_SIMULATION_SINGLE")
def test_step_is_refused_while_stopped(scene: SimulatorScene) -> None:
    """A stopped simulation is not stepped."""
    scene.bring_to(STOPPED)
    scene.simulator.expect(NOT_PAUSED, StepSimulation, steps=1)
    scene.must_be(STOPPED)


@clause("StepSimulation.srv: description", "STEP_SIMULATION_MULTIPLE")
def test_steps_return_to_paused(scene: SimulatorScene) -> None:
    """After several steps the simulation is paused."""
    scene.bring_to(PAUSED)
    _step(scene, STEPS)
    scene.must_be(PAUSED)


@clause("StepSimulation.srv: steps", "STEP_SIMULATION_MULTIPLE")
def test_steps_are_counted(scene: SimulatorScene) -> None:
    """Several steps advance the simulated time by as many times a single one."""
    name = _begun(scene)
    start = scene.nanos(name)
    _step(scene, 1)
    one = scene.nanos(name) - start
    _step(scene, STEPS)
    several = scene.nanos(name) - start - one
    if several != STEPS * one:
        wanted = f"{STEPS} steps of {one} ns, {STEPS * one} ns"
        fail(f"simulated time: expected {wanted}, got {several} ns")


@clause("SimulateSteps.action: description", "STEP_SIMULATION_ACTION")
def test_action_returns_to_paused(scene: SimulatorScene) -> None:
    """After the action's steps the simulation is paused."""
    scene.bring_to(PAUSED)
    Steps(scene.simulator, STEPS).succeed()
    scene.must_be(PAUSED)


@clause("SimulateSteps.action: completed_steps, remaining_steps", "STEP_SIMULATION_ACTION")
def test_feedback_adds_up(scene: SimulatorScene) -> None:
    """Completed and remaining steps are the steps of the goal; the completed ones increase."""
    scene.bring_to(PAUSED)
    steps = Steps(scene.simulator, STEPS)
    steps.succeed()
    completed = [done for done, _ in steps.feedback]
    if any(done + left != STEPS for done, left in steps.feedback):
        fail(f"SimulateSteps: expected feedback that adds up to {STEPS}, got {steps.feedback}")
    if completed != sorted({*completed}):
        fail(f"SimulateSteps: expected completed_steps to increase, got {completed}")


@clause("SimulateSteps.action: description", "STEP_SIMULATION_ACTION")
def test_feedback_follows_each_step(scene: SimulatorScene) -> None:
    """There is feedback after each step."""
    scene.bring_to(PAUSED)
    steps = Steps(scene.simulator, STEPS)
    steps.succeed()
    completed = [done for done, _ in steps.feedback]
    if completed != [*range(1, STEPS + 1)]:
        fail(f"SimulateSteps: expected feedback of step 1 to {STEPS}, got {completed}")


@clause("SimulateSteps.action: result", "STEP_SIMULATION_ACTION")
def test_action_is_refused_while_playing(scene: SimulatorScene) -> None:
    """The goal is rejected, or ends with a failure, while the simulation plays."""
    scene.bring_to(PLAYING)
    steps = Steps(scene.simulator, STEPS)
    if steps.handle.accepted:
        done = steps.end()
        scene.simulator.check(NOT_PAUSED, done.result.result, "SimulateSteps")
        if done.status == GoalStatus.STATUS_SUCCEEDED:
            fail("SimulateSteps: expected the goal to be aborted, it succeeded")
    scene.must_be(PLAYING)


@clause("SimulateSteps.action: description", "STEP_SIMULATION_ACTION")
def test_cancelled_action_returns_to_paused(scene: SimulatorScene) -> None:
    """Steps that are cancelled leave a paused simulation."""
    scene.bring_to(PAUSED)
    steps = Steps(scene.simulator, MANY_STEPS)
    if not steps.handle.accepted:
        not_tested(f"a goal of {MANY_STEPS} steps is rejected")
    scene.simulator.spin(0.1)
    response = scene.simulator.wait_for(steps.handle.cancel_goal_async(), "SimulateSteps responds")
    if not response.goals_canceling:
        fail("SimulateSteps: expected the request to cancel to be accepted, it was rejected")
    done = steps.end()
    if done.status != GoalStatus.STATUS_CANCELED:
        fail(f"SimulateSteps: expected the status STATUS_CANCELED (5), got {done.status}")
    scene.must_be(PAUSED)
