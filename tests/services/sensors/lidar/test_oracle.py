# SPDX-License-Identifier: Apache-2.0
"""Clouds of a whole model against the oracle: 136 bodies that move and turn, as does the sensor.

No ray is left out. One that passes an edge within micrometers may go either way, by what float32
rounds; with these seeds none does.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.messages.base import State
from groundlink.scenario.schema import Placement, Scenario
from groundlink.scene.bodies import link_solids
from groundlink.scene.build import solids
from groundlink.world.triangles import Triangles, merged
from services.sensors.rays import scene
from services.sensors.rays.builtin import BuiltinEngine
from services.sensors.rays.embree import EmbreeEngine
from services.sensors.rays.engine import RayEngine
from tests.services.sensors.rays import oracle

from . import rooms

FIRINGS = 1200
CLOSE_M = 1e-4

MOUNT = {"xyz_m": [0.1, -0.05, 0.4], "rpy_deg": [2.0, -3.0, 30.0]}
OTHERS = 33
HIGHEST_RADPS = 6.0


def whirling(generator: np.random.Generator, reach_m: float, fastest_mps: float) -> rooms.Way:
    """Straight on at a constant speed, with all three angles turning."""
    start, velocity = generator.uniform(-reach_m, reach_m, 3), generator.normal(size=3)
    start[2] = generator.uniform(0.3, 2.5)
    velocity *= fastest_mps / np.linalg.norm(velocity)
    angles, rates = generator.uniform(-3, 3, 3), generator.normal(size=3)
    rates *= HIGHEST_RADPS / np.linalg.norm(rates)

    def way(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (start + velocity * t).tolist(), (angles + rates * t).tolist()

    return way


def hulls(generator: np.random.Generator) -> list[dict[str, Any]]:
    """One for each vehicle beside the sensor's, up to 2 m from its vehicle's origin."""
    shapes: list[dict[str, Any]] = []
    for number in range(OTHERS):
        size = generator.uniform(0.3, 0.9, 3).round(3).tolist()
        shape = [
            {"kind": "box", "size_m": size},
            {"kind": "cylinder", "radius_m": size[0], "length_m": size[1]},
            {"kind": "sphere", "radius_m": size[2]},
        ][number % 3]
        place = generator.normal(size=3)
        place *= generator.uniform(0, 1.0) / np.linalg.norm(place)
        shapes.append(
            {"name": "hull", "shape": shape, "material": "dark", "position_m": place.tolist()}
        )
    return shapes


def meshes(made: Scenario) -> tuple[Triangles, list[Triangles]]:
    """Return the world and every link, with the labels that each solid has in its order."""
    static = solids(made)
    label = len(static)
    bodies = []
    for vehicle in made.vehicles:
        for link in link_solids(vehicle.model):
            bodies.append(merged(link, first_label=label))
            label += len(link)
    return merged(static), bodies


def rays_in_sensor(firings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions, shape (rings, firings, 3), and seconds, shape (firings,), by the sheet."""
    seconds = np.arange(firings) * 0.1 / firings
    elevation, azimuth = np.radians(np.arange(-15.0, 16.0, 2.0))[:, None], 20 * np.pi * seconds
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            -np.cos(elevation) * np.sin(azimuth),
            np.broadcast_to(np.sin(elevation), (16, firings)),
        ],
        axis=-1,
    ), seconds


def measured(cloud: Any) -> np.ndarray:
    """Return a cloud's ranges, shape (rings, firings), infinite where there is no point."""
    records = cloud.records()
    ranges = np.full((16, FIRINGS), np.inf)
    firing = np.rint(records["time"].astype(np.float64) / 0.1 * FIRINGS).astype(int)
    ranges[records["ring"], firing] = np.linalg.norm(rooms.points(cloud), axis=1)
    return ranges


class Revolution(NamedTuple):
    """What happens in a revolution, and what it measures by the oracle."""

    scenario: Scenario
    states: list[State]
    answer: oracle.Answer


@cache
def revolution(seed: int) -> Revolution:
    """Return a revolution, which is the same for every engine."""
    generator = np.random.default_rng(seed)
    made = rooms.scenario(
        others=hulls(generator), firings_per_revolution=FIRINGS, mount=MOUNT, min_range_m=0.0
    )
    # Their start positions only need to be apart.
    apart = [
        msgspec.structs.replace(v, placement=Placement(x_m=50.0 + 5.0 * i))
        for i, v in enumerate(made.vehicles)
    ]
    made = msgspec.structs.replace(made, vehicles=tuple(apart))
    own = whirling(generator, 1.0, 3.0)
    ways = [whirling(generator, 3.5, 15.0) for _ in range(OTHERS)]
    states = list(rooms.states(made, own, 41, others=ways))

    poses = np.array(
        [
            np.concatenate([state.vehicles[v.name].poses() for v in made.vehicles])
            for state in states
        ]
    )
    local, seconds = rays_in_sensor(FIRINGS)
    times = np.broadcast_to(seconds / 0.1, (16, FIRINGS)).reshape(-1)
    position, turn = oracle.between(poses[:, 0], times)
    base_from_sensor = matrix_from_quaternion(quaternion_from_rpy(*np.radians(MOUNT["rpy_deg"])))
    origins = position + turn @ np.array(MOUNT["xyz_m"])
    directions = np.einsum("nij,nj->ni", turn @ base_from_sensor, local.reshape(-1, 3))
    static, bodies = meshes(made)
    assert len(bodies) == 136
    answer = oracle.cast(static, bodies, poses, origins, directions, times, 100.0)
    assert np.mean(answer.body >= 0) > 0.2
    return Revolution(made, states, answer)


@pytest.mark.parametrize("engine", [EmbreeEngine, BuiltinEngine])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ranges_are_the_oracles(
    seed: int, engine: type[RayEngine], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene, "best_engine", lambda: engine)
    made, states, answer = revolution(seed)
    sensor = rooms.model(made)
    (cloud,) = [cloud for state in states for cloud in sensor.readings(state)]

    found = measured(cloud).reshape(-1)
    hit = np.isfinite(answer.range_m)
    np.testing.assert_array_equal(np.isfinite(found), hit)
    assert np.abs(found[hit] - answer.range_m[hit]).max() < CLOSE_M
