# SPDX-License-Identifier: Apache-2.0
"""Resources that can be spawned."""

from simulation_interfaces.msg import SpawnResult
from simulation_interfaces.srv import GetSpawnables

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.scene import OK, SPAWNERS, SimulatorScene
from simulation_interfaces_tck.shapes import flaw_of

MOST = 5
"""How many spawnables are tried."""


@clause("Resource.msg: uri", "SPAWNABLES")
def test_each_spawnable_has_a_resource(scene: SimulatorScene) -> None:
    """Uri and resource string are not both empty."""
    for spawnable in scene.simulator.expect(OK, GetSpawnables).spawnables:
        if not (spawnable.entity_resource.uri or spawnable.entity_resource.resource_string):
            fail(f"GetSpawnables: expected a uri or a resource string, got neither: {spawnable}")


@clause("Spawnable.msg: spawn_bounds", "SPAWNABLES")
def test_bounds_of_each_spawnable_are_valid(scene: SimulatorScene) -> None:
    """Bounds are empty or valid."""
    for spawnable in scene.simulator.expect(OK, GetSpawnables).spawnables:
        if flaw := flaw_of(spawnable.spawn_bounds):
            fail(f"GetSpawnables: {spawnable.entity_resource.uri}: {flaw}")


@clause("GetSpawnables.srv: sources", "SPAWNABLES")
def test_unrecognized_source_is_named_and_no_failure(scene: SimulatorScene) -> None:
    """A source that is not recognized stands in the error message of a successful response."""
    source = "tck://source/that/does/not/exist"
    response = scene.simulator.expect(OK, GetSpawnables, sources=[source])
    if source not in response.result.error_message:
        message = response.result.error_message
        fail(f"GetSpawnables: expected {source!r} in the error_message, got {message!r}")


@clause("GetSpawnables.srv: spawnables", "SPAWNABLES")
def test_spawnables_can_be_spawned(scene: SimulatorScene) -> None:
    """What is listed is a valid resource of a request to spawn; the first five are tried.

    A large one that the place has no room for is left out.
    """
    spawnables = scene.simulator.expect(OK, GetSpawnables).spawnables
    if not spawnables:
        not_tested("there are no spawnables")
    ways = [feature for feature in SPAWNERS if feature in scene.simulator.announced]
    if not ways:
        not_tested(f"needs {' or '.join(SPAWNERS)}")
    codes = (OK, SpawnResult.INVALID_POSE)
    got = []
    for spawnable in spawnables[:MOST]:
        resource = spawnable.entity_resource
        got.append(scene.expect_spawn(codes, ways[0], entity_resource=resource).result.result)
        scene.remove_spawned()
    if OK not in got:
        not_tested("there is no room for any of the first spawnables; name another --origin")
