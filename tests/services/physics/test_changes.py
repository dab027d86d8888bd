# SPDX-License-Identifier: Apache-2.0
"""Things come into a world that is being simulated, and go; nothing else notices."""

from collections.abc import Iterator

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages.base import Command, floats
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.build import solids
from groundlink.scene.change import with_more, without
from services.physics.simulation.simulation import Simulation

from .conftest import ROVER, run


class Run:
    """A scenario and its simulation, which change together."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.simulation = Simulation(scenario, solids(scenario))

    def spawn(self, given: str, *at: float, name: str | None = None) -> None:
        seconds, moving = self.simulation.sim_nanos * 1e-9, self.simulation.moving()
        _, more = addition(given, at=SpawnPlace(*at), name=name, taken=("rover/base",), ground=None)
        self._become(with_more(self.scenario, more, moving, seconds=seconds))

    def remove(self, name: str) -> None:
        self._become(without(self.scenario, name))

    def _become(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.simulation.become(scenario, solids(scenario))

    def touched(self) -> set[str]:
        return {c.name for told in self.simulation.vitals(0) for c in told.contacts}


@pytest.fixture
def here(lab: Scenario) -> Iterator[Run]:
    rover = replace(lab.vehicles[0], placement=Placement(x_m=-3.0))
    made = Run(replace(lab, vehicles=(rover,)))
    yield made
    made.simulation.close()


def test_a_box_is_in_the_way_until_it_is_removed(here: Run) -> None:
    run(here.simulation, 1.0)
    here.spawn("box", -1.5, 0.0)
    stopped = run(here.simulation, 3.0, (0.5, 0.0))
    assert stopped.last[0] < -1.75
    assert here.touched() == {"box"}
    here.remove("box")
    gone = run(here.simulation, 3.0, (0.5, 0.0))
    assert gone.last[0] > -1.2
    # What was touched before it went has its name.
    assert here.touched() <= {"box"}


def test_nothing_else_is_moved_by_a_change(here: Run) -> None:
    run(here.simulation, 0.5, (0.5, 0.0))
    before = here.simulation.vehicle_states()[ROVER]
    here.spawn("barrel", 1.0, 0.0)
    here.spawn("crate", 2.0, 0.0)
    here.remove("clutter_1")
    after = here.simulation.vehicle_states()[ROVER]
    assert bytes(before.link_poses) == bytes(after.link_poses)
    assert bytes(before.base_velocity) == bytes(after.base_velocity)
    moved = run(here.simulation, 1.0, (0.5, 0.0))
    np.testing.assert_allclose(moved.velocity[-100:, 0], 0.5, atol=0.01)
    assert np.abs(moved.velocity[:, 2]).max() < 0.01


def test_solids_that_shared_a_body_with_one_that_went_are_still_there(here: Run) -> None:
    here.spawn("box", -1.5, 1.2, name="one")
    here.spawn("box", -1.5, 0.25, name="two")
    for static in here.simulation._statics.values():
        assert len({s.name for s in static.solids} & {"one", "two"}) < 2
    # Built together they share one.
    with Simulation(here.scenario, solids(here.scenario)) as together:
        shared = [s.solids for s in together._statics.values()]
        assert any({"one", "two"} <= {solid.name for solid in some} for some in shared)
        changed = without(here.scenario, "one")
        together.become(changed, solids(changed))
        run(together, 4.0, (0.5, 0.0))
        assert {c.name for told in together.vitals(0) for c in told.contacts} == {"two"}


def test_a_vehicle_comes_drives_and_goes(here: Run) -> None:
    run(here.simulation, 0.5)
    here.spawn("rover", 0.0, 0.0, 0.0, 180.0, name="second")
    states = here.simulation.vehicle_states()
    assert list(states) == [ROVER, "second"]
    np.testing.assert_allclose(states["second"].poses()[0, :2], 0.0, atol=1e-9)
    for _ in range(1600):
        for name in (ROVER, "second"):
            now = here.simulation.sim_nanos
            here.simulation.command(name, Command(now, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0)))
        here.simulation.step()
    assert here.touched() == {ROVER, "second"}
    here.remove("second")
    assert list(here.simulation.vehicle_states()) == [ROVER]
    alone = run(here.simulation, 2.0, (0.5, 0.0))
    assert alone.last[0] > alone.pose[0, 0] + 0.5


def test_actors_are_published_in_scenario_order(here: Run) -> None:
    here.spawn("crate", 0.0, 0.0, name="zebra")
    here.spawn("crate", 2.0, 0.0, name="ape")
    rows = floats(here.simulation.actor_poses()).reshape(-1, 7)
    np.testing.assert_allclose(rows[:, 0], [0.0, 2.0])
    here.remove("zebra")
    rows = floats(here.simulation.actor_poses()).reshape(-1, 7)
    np.testing.assert_allclose(rows[:, 0], [2.0])


def test_two_runs_with_the_same_changes_have_the_same_bytes(lab: Scenario) -> None:
    told = []
    for _ in range(2):
        it = Run(lab)
        run(it.simulation, 0.5, (1.0, 0.2))
        it.spawn("crate", -3.4, 0.2)
        run(it.simulation, 1.0, (1.0, 0.2))
        it.remove("clutter_2")
        trace = run(it.simulation, 1.0, (1.0, 0.2))
        told.append((trace.pose.tobytes(), bytes(it.simulation.actor_poses())))
        it.simulation.close()
    assert told[0] == told[1]
