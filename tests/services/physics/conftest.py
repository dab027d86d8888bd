# SPDX-License-Identifier: Apache-2.0
"""The shipped laboratory, its rover placed where a test wants it, and runs of it."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.build import solids
from groundlink.world.solids import Solid
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import drive

LAB = Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"
ROVER = "rover"


run = partial(drive, name=ROVER)


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
