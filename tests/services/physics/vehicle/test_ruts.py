# SPDX-License-Identifier: Apache-2.0
"""Vehicles leave ruts in soft terrain, and feel those that are there."""

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from numpy.typing import NDArray
from scipy.optimize import brentq

from groundlink.messages.base import Ruts
from groundlink.messages.ground_truth import WheelInSoil
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.world.ruts import NO_RUTS, SIDE, STEP_M, TILE, RutGrid, digest_of, split
from groundlink.world.solids import Material
from groundlink.world.terrain import load_ground
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation, SimulationMemory
from services.physics.soil.ruts import (
    MOST_AT_ONCE,
    PUBLISH_TICKS,
    PressedRuts,
    RutHistory,
    RutMemory,
)
from services.physics.soil.track import TrackSection, track_forces
from services.physics.soil.wheel import wheel_forces, wheel_sinkage
from services.physics.trials.track import NAME, drive
from tests.services.physics.grounds import SOILS, shipped
from tests.services.physics.terrains import terrain, world

SECOND = f"{NAME}1"


def field(soil: str | None, *placed: tuple[str, Placement]) -> Scenario:
    """Return a scenario of vehicles on level terrain."""
    ground = Material(friction=1.0, soil=SOILS[soil] if soil else UNSET)
    vehicles = [(shipped(vehicle), place) for vehicle, place in placed]
    return world(terrain(np.zeros((31, 31))), *vehicles, materials={"ground": ground})


def there(x_m: float, y_m: float = 0.0, yaw_deg: float = 0.0) -> Placement:
    return Placement(x_m=x_m, y_m=y_m, yaw_deg=yaw_deg)


def ruts_of(simulation: Simulation) -> PressedRuts:
    assert simulation.ruts is not None
    return simulation.ruts


def depths_m(grid: RutGrid) -> NDArray[np.float64]:
    """Return the depth at each vertex, shape (rows, columns)."""
    rows, columns = (-(-n // SIDE) * SIDE for n in (grid.rows, grid.columns))
    found = np.zeros((rows, columns))
    for number, key in enumerate(grid.keys[: grid.count].tolist()):
        row, column = (SIDE * n for n in divmod(key, grid.tile_columns))
        found[row : row + SIDE, column : column + SIDE] = grid.depths[number] * STEP_M
    return found[: grid.rows, : grid.columns]


def twice(
    simulation: Simulation, vehicle: str, seconds: float, speed: float
) -> list[tuple[tuple[WheelInSoil, ...], float]]:
    """Drive, then again from the same place; return wheels at the end and motor work a meter."""
    [(start, _)] = simulation.motions().values()
    found = []
    for share in (1.0, 0.6):
        simulation.place(NAME, start, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        drive(simulation, 0.5 * share * seconds, (speed, 0.0))
        [before] = simulation.vitals(0)
        driven = drive(simulation, 0.5 * share * seconds, (speed, 0.0))
        [after] = simulation.vitals(0)
        way = float(np.hypot(*(driven.pose[-1] - driven.pose[0])[:2]))
        found.append((after.soil or (), (after.motor_work_j - before.motor_work_j) / way))
    return found


@pytest.mark.parametrize(("soil", "yaw_deg"), [("dry_sand", 25.0), ("lete_sand", 0.0)])
def test_a_rover_that_comes_back_sinks_and_slips_as_theory_says(soil: str, yaw_deg: float) -> None:
    """Four wheels, each in the rut of those before."""
    with Simulation(field(soil, ("rover", there(-2.0, 0.013, yaw_deg))), ()) as simulation:
        passes = [wheels[::2] for wheels, _ in twice(simulation, "rover", 6.0, 0.5)]
    wheel, load = shipped("rover").wheels[0], np.array(55.0 * GRAVITY_MPS2 / 4)
    size = wheel.radius_m, wheel.width_m

    def pull(slip: float, rut: float) -> tuple[float, list[float]]:
        """Return the drawbar pull of two wheels in a rut, and the sinkage of each."""
        total, sunk = 0.0, [rut]
        for _ in range(2):
            before, s = np.array(sunk[-1]), np.array(slip)
            depth = wheel_sinkage(SOILS[soil], *size, load, s, before)
            total += float(wheel_forces(SOILS[soil], *size, depth, s, before).drawbar_n)
            sunk.append(float(depth))
        return total, sunk[1:]

    rut = 0.0
    for wheels in passes:
        slip = brentq(lambda s, rut=rut: pull(s, rut)[0], 0.02, 0.6, xtol=1e-4)
        _, expected = pull(slip, rut)
        assert [found.slip for found in wheels] == pytest.approx([slip] * 2, rel=0.05)
        assert [found.sinkage_m for found in wheels] == pytest.approx(expected, rel=0.05)
        rut = expected[-1]


def test_a_tank_that_comes_back_does_no_work_of_compaction() -> None:
    soil, tank = SOILS["clayey_soil_55"], shipped("tank")
    with Simulation(field("clayey_soil_55", ("tank", there(-6.0))), ()) as simulation:
        (first, work), (second, again) = twice(simulation, "tank", 8.0, 1.0)
    wheel = next(w for w in tank.wheels if w.name == "left_wheel_1")
    whole_kg = tank.chassis.mass_kg + sum(w.mass_kg for w in tank.wheels)
    assert tank.vibration
    assert tank.vibration.tread
    track = TrackSection(wheel.width_m, 0.93, 0.0, 2 * wheel.radius_m, tank.vibration.tread.pitch_m)
    load = np.array(whole_kg * GRAVITY_MPS2 / 10)
    resistance = 2 * float(track_forces(soil, track, load, np.array(0.0)).resistance_n)
    assert work - again == pytest.approx(resistance, rel=0.05)
    assert second[0].sinkage_m == pytest.approx(first[0].sinkage_m, rel=0.02)


def test_a_rover_feels_the_ruts_of_a_tank() -> None:
    """The rover crosses one: its front comes down into it and up again."""
    placed = ("tank", there(4.0)), ("rover", there(0.0, 3.0, yaw_deg=-90.0))
    with Simulation(field("clayey_soil_55", *placed), ()) as simulation:
        drive(simulation, 6.0, (-2.0, 0.0))
        depths = depths_m(ruts_of(simulation))
        crossing = drive(simulation, 4.5, (0.8, 0.0), SECOND)
    [in_rut] = np.nonzero(depths[:, 300] > 0.05)
    edges_m = in_rut.min() * 0.05 - 15.0, in_rut.max() * 0.05 - 15.0
    assert edges_m == pytest.approx((-1.61, 1.61), abs=0.05)
    assert depths[:, 300].max() == pytest.approx(0.0905, abs=1e-3)
    fronts_m, heights_m = crossing.pose[:, 1] - 0.256, crossing.pose[:, 2]
    level = heights_m[(fronts_m > 1.9) & (fronts_m < 2.2)].mean()
    inside = heights_m[(fronts_m > 1.2) & (fronts_m < 1.4)].mean()
    assert level - inside == pytest.approx(0.09 / 2, rel=0.25)


def test_changes_are_published_in_parts_at_a_bounded_rate() -> None:
    """Whoever takes all messages has the ruts; the memory and the history have them, too."""
    with Simulation(field("clayey_soil_55", ("tank", there(-6.0))), ()) as simulation:
        ruts, sent, followed = ruts_of(simulation), [], RutGrid((31, 31), 1.0, -15.0, -15.0)
        history = RutHistory(ruts, 2 * PUBLISH_TICKS)
        for tick in range(1, 1021):
            drive(simulation, 1 / 400, (8.0, 0.0))
            now = ruts.at(tick)
            history.take(now)
            if now and now.tiles:
                assert tick % PUBLISH_TICKS == 0
                assert now.before == (sent[-1].digest if sent else NO_RUTS)
                sent.append(now)
                followed.put(np.frombuffer(now.tiles, TILE))
        memory = ruts.memory()
        assert now
        depths, pressed = depths_m(followed), depths_m(ruts)
        published = b"".join(ruts.published.values())
    assert len(sent) > 10
    assert max(len(now.tiles) for now in sent) < MOST_AT_ONCE * TILE.itemsize
    assert digest_of(split(published)) == now.digest
    assert memory.published == published
    assert memory.pending
    behind = pressed - depths
    assert behind.min() == 0.0
    assert np.count_nonzero(behind) < 0.2 * np.count_nonzero(pressed)
    assert sorted(split(history.with_digest(now.digest) or b"")) == sorted(split(published))
    before = history.with_digest(sent[-1].before)
    assert before is not None
    assert digest_of(split(before)) == sent[-1].before
    assert history.with_digest(sent[0].digest) is None


def test_many_changes_wait_for_the_next_message() -> None:
    ruts = PressedRuts(load_ground(terrain(np.zeros((31, 31)))), memory_of(MOST_AT_ONCE + 5))
    first, second = ruts.at(0), ruts.at(PUBLISH_TICKS)
    assert first
    assert second
    assert len(first.tiles) == MOST_AT_ONCE * TILE.itemsize
    assert len(second.tiles) == 5 * TILE.itemsize
    assert ruts.at(2 * PUBLISH_TICKS) == Ruts(second.digest)


def memory_of(count: int) -> RutMemory:
    """Return the memory of ruts of which no process knows yet."""
    tiles = np.zeros(count, TILE)
    tiles["key"], tiles["depths"] = np.arange(count), 5
    return RutMemory(b"", tiles.tobytes())


def test_ruts_continue_from_memory_with_the_same_bytes() -> None:
    described = field("lete_sand", ("rover", there(0.0)))
    with Simulation(described, ()) as simulation:
        for tick in range(1, 431):
            drive(simulation, 1 / 400, (1.0, 0.5))
            ruts_of(simulation).at(tick)
        memory = simulation.memory()
    coded = msgspec.msgpack.decode(msgspec.msgpack.encode(memory), type=SimulationMemory)
    runs = []
    for _ in range(2):
        with Simulation(described, (), memory=coded) as simulation:
            ruts = ruts_of(simulation)
            assert ruts.memory() == memory.ruts
            found = []
            for tick in range(431, 600):
                found.append((drive(simulation, 1 / 400, (1.0, 0.5)).pose.tobytes(), ruts.at(tick)))
            runs.append(found)
    assert runs[0] == runs[1]
    assert sum(1 for _, now in runs[0] if now and now.tiles) >= 4


def test_a_state_reset_levels_the_ground() -> None:
    described = field("lete_sand", ("rover", there(0.0)))
    with Simulation(described, ()) as simulation:
        drive(simulation, 1.0, (1.0, 0.0))
        assert ruts_of(simulation).at(400)
        simulation.reset_state(described)
        assert depths_m(ruts_of(simulation)).max() == 0.0
        assert ruts_of(simulation).at(401) is UNSET


def test_firm_terrain_and_floors_have_no_ruts() -> None:
    for scenario in (
        field(None, ("rover", there(0.0))),
        world(None, (shipped("rover"), there(0.0))),
    ):
        with Simulation(scenario, ()) as simulation:
            assert simulation.ruts is None
            assert simulation.memory().ruts is None


def test_a_full_terrain_is_told() -> None:
    with Simulation(field("lete_sand", ("rover", there(0.0))), ()) as simulation:
        ruts = ruts_of(simulation)
        ruts._most = 3
        drive(simulation, 3.0, (1.0, 0.0))
        assert ruts.count == 3
        assert ruts.is_full
