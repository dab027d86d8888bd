# SPDX-License-Identifier: Apache-2.0
"""Small worlds for sensors that look about, and states of a vehicle in them with all its links."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from groundlink.messages.base import State, packed
from groundlink.scenario.schema import Datum, Scenario
from groundlink.world.solids import Box, Material, Solid
from tests.services.sensors.states import WHEELS, scenario, states

DATUM = Datum(52.25, 20.9, 140.0, 31.0)


def box(name: str, size_m: Sequence[float], at_m: Sequence[float], material: str = "gray") -> Solid:
    x, y, z = size_m
    return Solid(name, Box((x, y, z)), material, position_m=tuple(at_m))  # type: ignore[arg-type]


def yard(*solids: Solid, seed: int = 1, **fields: Any) -> Scenario:
    """Return a scenario with these solids; `gray` reflects a half, `black` an eighth."""
    made = scenario(seed=seed, **fields)
    far = box("far", (1, 1, 1), (0, 0, -500))
    materials = {"gray": Material(0.5), "black": Material(0.125), "rubber": Material(0.05)}
    world = replace(made.world, datum=DATUM, materials=materials, solids=(far, *solids))
    return replace(made, world=world)


def moving(
    positions: ArrayLike,
    quaternions: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    *,
    velocities: ArrayLike = (0.0,) * 6,
    first_tick: int = 0,
) -> Iterator[State]:
    """Yield one state a tick; positions (ticks, 3), velocities (6,) or (ticks, 6)."""
    places = np.asarray(positions, np.float64)
    speeds = np.broadcast_to(np.asarray(velocities, np.float64), (len(places), 6))
    for i, state in enumerate(states(places, quaternions, first_tick=first_tick)):
        rover = state.vehicles["rover"]
        links = np.repeat(rover.poses(), 1 + len(WHEELS), axis=0)
        rover = replace(rover, link_poses=packed(links), base_velocity=packed(speeds[i].copy()))
        yield replace(state, vehicles={"rover": rover})


def resting(ticks: int, at_m: Sequence[float] = (0.0, 0.0, 0.0), **fields: Any) -> list[State]:
    return list(moving(np.tile(np.asarray(at_m, np.float64), (ticks, 1)), **fields))
