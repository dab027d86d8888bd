# SPDX-License-Identifier: Apache-2.0
"""The shipped laboratory, its rover placed where a test wants it, and runs of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.loader import load
from groundlink.messages.base import Command, floats
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.world.build import solids
from groundlink.world.solids import Solid
from services.physics.simulation.simulation import Simulation

LAB = Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"
ROVER = "rover"


@dataclass(frozen=True)
class Trace:
    """What happened, a row a tick: base pose and velocity, wheel angles, wheels in the world."""

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angles: NDArray[np.float64]
    wheels: NDArray[np.float64]

    @property
    def last(self) -> NDArray[np.float64]:
        pose: NDArray[np.float64] = self.pose[-1]
        return pose


def run(simulation: Simulation, seconds: float, twist: tuple[float, float] | None = None) -> Trace:
    """Step, with a command of (m/s, rad/s) a tick where one is given."""
    rows = []
    for _ in range(round(seconds * 400)):
        if twist is not None:
            command = Command(simulation.sim_nanos, (twist[0], 0.0, 0.0), (0.0, 0.0, twist[1]))
            simulation.command(ROVER, command)
        simulation.step()
        state = simulation.vehicle_states()[ROVER]
        poses = state.poses()
        rows.append(
            (poses[0], floats(state.base_velocity), floats(state.joint_positions), poses[1:])
        )
    return Trace(*(np.array(column) for column in zip(*rows, strict=True)))


@pytest.fixture(scope="session")
def lab() -> Scenario:
    return load(LAB)


Start = Callable[..., Simulation]


@pytest.fixture
def start(lab: Scenario) -> Iterator[Start]:
    """Return a function that starts a simulation; all of them end with the test."""
    started = []

    def begin(
        placement: Placement | None = None,
        extra: tuple[Solid, ...] = (),
        only: tuple[str, ...] = ("",),
    ) -> Simulation:
        rover = lab.vehicles[0]
        scenario = replace(lab, vehicles=(replace(rover, placement=placement or rover.placement),))
        built = [solid for solid in solids(scenario) if solid.name.startswith(only)]
        simulation = Simulation(scenario, (*built, *extra))
        started.append(simulation)
        return simulation

    yield begin
    for simulation in started:
        simulation.close()
