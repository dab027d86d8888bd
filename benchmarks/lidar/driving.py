# SPDX-License-Identifier: Apache-2.0
"""Vehicles of a scenario that drive a curve, and the same room in PyBullet."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.frames import Floats, matrix_from_quaternion, multiply, quaternion_from_rpy
from groundlink.messages.base import State, VehicleState, packed
from groundlink.scenario import Scenario
from groundlink.scene.bodies import link_solids
from groundlink.scene.build import solids
from groundlink.world.solids import Solid
from groundlink.world.triangles import merged

from .bullet import ORIGIN, Bullet

SPEED_MPS, TURN_RADPS = 1.0, 0.5


def link_poses(scenario: Scenario, tick: int) -> dict[str, Floats]:
    """Return world_from_link of every vehicle, shape (links, 7), on its way along a circle."""
    poses = {}
    for vehicle in scenario.vehicles:
        place, wheels = vehicle.placement, vehicle.model.wheels
        turned = TURN_RADPS * tick * TICK_SECONDS
        yaw, radius = np.radians(place.yaw_deg), SPEED_MPS / TURN_RADPS
        ahead = [np.sin(turned) * radius, (1 - np.cos(turned)) * radius, 0.0]
        start = matrix_from_quaternion(quaternion_from_rpy(0, 0, yaw))
        base = start @ ahead + (place.x_m, place.y_m, place.z_m + wheels[0].radius_m)
        turn = quaternion_from_rpy(0, 0, yaw + turned)
        rolled = quaternion_from_rpy(0, SPEED_MPS * tick * TICK_SECONDS / wheels[0].radius_m, 0)
        centers = np.array([wheel.center_m for wheel in wheels]) @ matrix_from_quaternion(turn).T
        poses[vehicle.name] = np.array(
            [[*base, *turn], *([*(base + c), *multiply(turn, rolled)] for c in centers)]
        )
    return poses


def states(scenario: Scenario) -> Iterator[State]:
    """Yield the states of a run."""
    none, tick = packed(np.zeros(0)), 0
    while True:
        vehicles = {
            name: VehicleState(packed(poses), packed(np.zeros(6)), none, none)
            for name, poses in link_poses(scenario, tick).items()
        }
        yield State("benchmark", 0, 0, tick, tick * TICK_NANOS, "", vehicles)
        tick += 1


def in_bullet(scenario: Scenario) -> Bullet:
    """Return the scenario in PyBullet, its vehicles at their start, each solid a body."""
    bullet = Bullet()
    for frame, pose in _frames(scenario):
        for solid in frame:
            bullet.add(solid, pose)
    return bullet


def as_meshes_in_bullet(scenario: Scenario, folder: Path) -> Bullet:
    """Return the same, all solids of a frame as one mesh."""
    bullet = Bullet()
    for frame, pose in _frames(scenario):
        if frame:
            bullet.add_mesh(merged(frame), folder, pose[None])
    return bullet


def _frames(scenario: Scenario) -> Iterator[tuple[Sequence[Solid], Floats]]:
    """Yield the solids of the world and of each link, with the pose of their frame."""
    yield solids(scenario), ORIGIN[0]
    for vehicle in scenario.vehicles:
        poses = link_poses(scenario, 0)[vehicle.name]
        yield from zip(link_solids(vehicle.model), poses, strict=True)
