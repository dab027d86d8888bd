# SPDX-License-Identifier: Apache-2.0
"""Reset, and its scopes."""

from simulation_interfaces.msg import EntityState, Result
from simulation_interfaces.srv import ResetSimulation, SetEntityState

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.scene import OK, PAUSED, PLAYING, SPAWNERS, SimulatorScene
from simulation_interfaces_tck.shapes import distance, pose_at, stamped

Request = ResetSimulation.Request
UNSUPPORTED = Result.RESULT_FEATURE_UNSUPPORTED
SCOPES = {
    "SIMULATION_RESET_TIME": Request.SCOPE_TIME,
    "SIMULATION_RESET_STATE": Request.SCOPE_STATE,
    "SIMULATION_RESET_SPAWNED": Request.SCOPE_SPAWNED,
}


def _can_spawn(scene: SimulatorScene) -> bool:
    return any(feature in scene.simulator.announced for feature in SPAWNERS)


def _elapse(scene: SimulatorScene) -> int:
    """Let simulated time elapse; return the paused clock."""
    scene.bring_to(PLAYING)
    scene.simulator.clock_goes_on()
    scene.bring_to(PAUSED)
    return scene.simulator.clock_nanos()


@clause("SimulatorFeatures.msg: SIMULATION_RESET", "SIMULATION_RESET")
def test_one_scope_at_least_is_supported(scene: SimulatorScene) -> None:
    """Whoever announces resets does one: of all, or of a scope."""
    scopes = (Request.SCOPE_DEFAULT, Request.SCOPE_ALL, *SCOPES.values())
    codes = [scene.simulator.call(ResetSimulation, scope=scope).result.result for scope in scopes]
    if OK not in codes:
        fail(f"ResetSimulation: expected RESULT_OK of a scope of {scopes}, got {codes}")


@clause("ResetSimulation.srv: SCOPE_DEFAULT", "SIMULATION_RESET")
def test_default_scope_is_all(scene: SimulatorScene) -> None:
    """The default resets all: each of the scopes that the simulator supports, and no less."""
    spawned = scene.spawn() if _can_spawn(scene) else ""
    wanted = {*SCOPES} <= scene.simulator.announced
    codes = OK if wanted else (OK, UNSUPPORTED)
    default = scene.simulator.expect(codes, ResetSimulation, scope=Request.SCOPE_DEFAULT)
    if default.result.result == OK and spawned:
        scene.must_lack(spawned)
    scene.simulator.expect(default.result.result, ResetSimulation, scope=Request.SCOPE_ALL)


@clause(
    "ResetSimulation.srv: SCOPE_TIME", "SIMULATION_RESET_TIME", needs=["SIMULATION_STATE_PAUSE"]
)
def test_time_is_reset_to_the_start(scene: SimulatorScene) -> None:
    """SCOPE_TIME resets the simulated clock."""
    before = _elapse(scene)
    scene.reset(Request.SCOPE_TIME)
    if (after := scene.simulator.clock_nanos()) >= before:
        fail(f"/clock: expected less than {before} ns after the reset, got {after} ns")


@clause("ResetSimulation.srv: SCOPE_TIME", "SIMULATION_RESET_TIME")
def test_reset_of_time_keeps_entities(scene: SimulatorScene) -> None:
    """SCOPE_TIME despawns nothing."""
    name = scene.spawn()
    scene.reset(Request.SCOPE_TIME)
    scene.must_have(name)


@clause(
    "ResetSimulation.srv: SCOPE_STATE",
    "SIMULATION_RESET_STATE",
    needs=["ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING"],
)
def test_reset_of_state_moves_entities_back(scene: SimulatorScene) -> None:
    """SCOPE_STATE resets poses, and despawns nothing."""
    scene.hold_still()
    name = scene.spawn(initial_pose=stamped(pose_at(scene.new_place())))
    moved = EntityState(pose=pose_at(scene.new_place()))
    scene.simulator.expect(OK, SetEntityState, entity=name, state=moved, set_pose=True)
    scene.reset(Request.SCOPE_STATE)
    scene.must_have(name)
    if distance(scene.pose_of(name).pose, moved.pose) <= scene.tolerance:
        fail(f"GetEntityState: expected {name!r} to be moved back by the reset; it was not")


@clause("ResetSimulation.srv: SCOPE_SPAWNED", "SIMULATION_RESET_SPAWNED")
def test_reset_of_spawned_removes_them_alone(scene: SimulatorScene) -> None:
    """SCOPE_SPAWNED despawns what was spawned, and keeps all else."""
    scene.reset(Request.SCOPE_SPAWNED)  # what others have spawned goes first
    before = sorted(scene.entities())
    scene.spawn()
    scene.spawn()
    scene.reset(Request.SCOPE_SPAWNED)
    if (after := sorted(scene.entities())) != before:
        fail(f"GetEntities: expected {before} after the reset, got {after}")


@clause("ResetSimulation.srv: scope", "SIMULATION_RESET_SPAWNED")
def test_scopes_are_bits(scene: SimulatorScene) -> None:
    """Two scopes are reset in one call."""
    announced = scene.simulator.announced
    others = [name for name in SCOPES if name in announced and name != "SIMULATION_RESET_SPAWNED"]
    if not others:
        not_tested("there is no second scope")
    name = scene.spawn()
    is_clocked = others[0] == "SIMULATION_RESET_TIME" and "SIMULATION_STATE_PAUSE" in announced
    before = _elapse(scene) if is_clocked else 0
    scene.reset(SCOPES[others[0]] | Request.SCOPE_SPAWNED)
    scene.must_lack(name)
    if is_clocked and (after := scene.simulator.clock_nanos()) >= before:
        fail(f"/clock: expected less than {before} ns after the reset, got {after} ns")
