# SPDX-License-Identifier: Apache-2.0
"""SpawnEntities with more and less than one request."""

from typing import Any

from simulation_interfaces.msg import Resource, Result, SpawnEntity, SpawnResult
from simulation_interfaces.srv import SpawnEntities

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail
from simulation_interfaces_tck.scene import OK, SimulatorScene

FAILED = SpawnEntities.Response.ENTITIES_SPAWN_FAILED


def spawn_all(scene: SimulatorScene, *requests: dict[str, Any]) -> Any:
    """Spawn in one call; return the response, with a result for each request."""
    wanted = [SpawnEntity(**scene.request(**fields)) for fields in requests]
    response = scene.simulator.call(SpawnEntities, spawn_requests=wanted)
    for spawned in response.results:
        if spawned.result.result == OK:
            scene.note(spawned.entity_name)
    if len(response.results) != len(requests):
        fail(f"expected {len(requests)} results, got {len(response.results)}")
    return response


def check(scene: SimulatorScene, codes: list[int], response: Any) -> None:
    """Fail unless the results have these codes, in this order."""
    for code, spawned in zip(codes, response.results, strict=True):
        scene.simulator.check(code, spawned.result, "SpawnEntities: results", SpawnResult)
    summary = OK if {*codes} <= {OK} else FAILED
    scene.simulator.check(summary, response.result, "SpawnEntities", SpawnEntities.Response)


@clause("SpawnEntities.srv: result", "SPAWNING_ENTITIES")
def test_no_request_is_no_failure(scene: SimulatorScene) -> None:
    """An empty list of requests has an empty list of results."""
    check(scene, [], spawn_all(scene))


@clause("SpawnEntities.srv: results", "SPAWNING_ENTITIES")
def test_results_are_in_the_order_of_the_requests(scene: SimulatorScene) -> None:
    """Each request has its result, at the same place in the list."""
    names = [scene.new_name() for _ in range(3)]
    response = spawn_all(scene, *({"name": name} for name in names))
    check(scene, [OK] * 3, response)
    got = [spawned.entity_name for spawned in response.results]
    if got != names:
        fail(f"expected the entities {names}, got {got}")
    for name in names:
        scene.must_have(name)


@clause("SpawnEntities.srv: ENTITIES_SPAWN_FAILED", "SPAWNING_ENTITIES")
def test_one_failed_request_is_told_by_its_result(scene: SimulatorScene) -> None:
    """If a request fails, the summary says that one did, and its result says which and why."""
    first, failed, last = (scene.new_name() for _ in range(3))
    nothing = {"name": failed, "entity_resource": Resource()}
    response = spawn_all(scene, {"name": first}, nothing, {"name": last})
    scene.simulator.check(FAILED, response.result, "SpawnEntities", SpawnEntities.Response)
    code = SpawnResult.NO_RESOURCE
    result = response.results[1].result
    scene.simulator.check(code, result, "SpawnEntities: results[1]", SpawnResult)
    scene.must_lack(failed)
    for name, spawned in ((first, response.results[0]), (last, response.results[2])):
        if spawned.result.result == Result.RESULT_OK:
            scene.must_have(name)
        else:
            scene.must_lack(name)


@clause("SpawnResult.msg: NAME_NOT_UNIQUE", "SPAWNING_ENTITIES")
def test_name_that_is_requested_twice_is_refused_once(scene: SimulatorScene) -> None:
    """Two requests of one call can't have one name."""
    name = scene.new_name()
    check(
        scene, [OK, SpawnResult.NAME_NOT_UNIQUE], spawn_all(scene, {"name": name}, {"name": name})
    )
