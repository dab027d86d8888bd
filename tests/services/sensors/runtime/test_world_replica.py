# SPDX-License-Identifier: Apache-2.0
"""World replica: poses of the links in each state."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.messages.base import State, VehicleState, packed
from groundlink.scenario.every_sensor import Mount
from groundlink.scene.bodies import link_solids
from services.sensors.runtime.world_replica import WorldReplica

ROVERS = load(str(Path(__file__).parents[4] / "scenarios" / "two_rovers.yaml"))


def state(tick: int, x_m: float) -> State:
    """Return a state in which every link is at this place."""
    pose = np.array([x_m, 0, 0, 0, 0, 0, 1.0])
    vehicles = {}
    for vehicle in ROVERS.vehicles:
        links = packed(np.tile(pose, (len(link_solids(vehicle.model)), 1)))
        still = [packed(np.zeros(count)) for count in (6, 4, 4)]
        vehicles[vehicle.name] = VehicleState(links, *still)
    return State("run", 1, 0, tick, 0, "", vehicles)


def test_replicas_of_a_scenario_share_the_poses_of_a_state() -> None:
    first, second = (WorldReplica(ROVERS, vehicle, Mount()) for vehicle in ROVERS.vehicles)
    for tick in range(3):
        now = state(tick, float(tick))
        for replica in (first, second):
            replica.take(now)
    assert all(map(np.shares_memory, first._poses, second._poses))
    assert [float(poses[0, 0]) for poses in second._poses] == [0.0, 1.0, 2.0]


def test_replicas_of_different_scenarios_get_their_own_poses_of_a_state() -> None:
    alone = replace(ROVERS, vehicles=ROVERS.vehicles[1:])
    both = WorldReplica(ROVERS, ROVERS.vehicles[1], Mount())
    one = WorldReplica(alone, alone.vehicles[0], Mount())
    now = state(0, 5.0)
    for replica in (both, one, both):
        replica.take(now)
    assert both.motion(0, 0).shape[1] == 2 * one.motion(0, 0).shape[1]
