# SPDX-License-Identifier: Apache-2.0
"""What every shipped vehicle can: drive, turn, climb, stand, and stay in the world."""

from math import asin, atan, degrees, radians, sin, tan

import numpy as np
import pytest

from groundlink.messages.base import Command, State, encode, floats
from groundlink.report.analysis.trials import Trial
from groundlink.scenario.running_gear import Omnidirectional, SideSteered, Wheel
from groundlink.scenario.schema import Placement
from groundlink.world.solids import Material
from services.physics.trials.maneuvers import climb, lean, stand, stop, straight, turn
from services.physics.trials.track import NAME, drive, put

from . import terrains
from .grounds import STEEP_DEG, VEHICLES, rubble, shipped, wall
from .tipping import tipping_deg

pytestmark = pytest.mark.parametrize("name", VEHICLES)

STILL = (0.0, 0.0)

ROUGH_SECONDS = 30.0
"""Of random commands on rubble; 600 s a vehicle hold too, and take twenty times as long."""


def acceleration_s(name: str, speed: float) -> float:
    return speed / shipped(name).drive.max_acceleration_mps2


def passes(trial: Trial) -> dict[str, float]:
    """Check the figures of a trial; return them by name."""
    assert [figure for figure in trial.figures if not figure.good] == []
    return {figure.name: figure.value for figure in trial.figures}


def test_stands_still_without_a_sound(name: str) -> None:
    assert passes(stand(shipped(name)))["shaking"] < 0.05


def test_drives_straight_as_its_odometry_measures(name: str) -> None:
    figures = passes(straight(shipped(name)))
    assert figures["driven"] > 10.0
    assert figures["rolled by the wheels"] == pytest.approx(figures["driven"], rel=0.01)
    assert figures["aside"] < 0.01 * figures["driven"]


def test_turns_as_it_is_asked_with_the_effective_track_of_its_drive(name: str) -> None:
    drive_spec = shipped(name).drive
    figures = passes(turn(shipped(name)))
    if isinstance(drive_spec, Omnidirectional):
        assert figures["turned by the wheels"] == pytest.approx(1.8, rel=0.01)
    else:
        multiplier = drive_spec.track_multiplier if isinstance(drive_spec, SideSteered) else 1.0
        assert figures["effective over geometric track"] == pytest.approx(multiplier, rel=0.01)
    assert figures.get("wandered", 0.0) < 0.1


def test_stops_from_its_full_speed(name: str) -> None:
    model = shipped(name)
    figures = passes(stop(model))
    assert figures["speed reached"] == pytest.approx(model.top_speed_mps, rel=0.05)
    shortest = model.top_speed_mps**2 / (2 * model.drive.max_acceleration_mps2)
    assert figures["stopping distance"] > 0.9 * shortest


def test_climbs_a_slope_and_holds_on_it(name: str) -> None:
    figures = passes(climb(shipped(name), STEEP_DEG))
    assert figures["height reached"] > 2.5
    assert figures["slid"] < 5.0
    assert figures["pitch"] == pytest.approx(STEEP_DEG, abs=5.0)


def _grip_aside(wheel: Wheel) -> float:
    """Return the friction along the axle over that of the tread; rollers grip aslant, in pairs."""
    if wheel.rollers:
        return abs(sin(radians(wheel.rollers.angle_deg)))
    return wheel.axle_friction_ratio


def test_leans_until_it_slides_or_tips(name: str) -> None:
    """Tires slide where the slope is their friction; see `test_tipping` for those that tip."""
    model = shipped(name)
    (limit,) = lean(model).figures
    if limit.name == "tips at":
        assert limit.value == pytest.approx(tipping_deg(model), abs=2.5)
    else:
        assert limit.name == "slides at"
        friction = min(wheel.friction * _grip_aside(wheel) for wheel in model.wheels)
        assert limit.value == pytest.approx(degrees(atan(friction)), abs=2.5)


def test_stands_across_a_slope_of_grass(name: str) -> None:
    across = np.linspace(-20.0, 20.0, 81)[:, None] * np.full(81, tan(radians(STEEP_DEG)))
    grass = {"ground": Material(friction=0.8)}
    with terrains.put(terrains.terrain(across, 0.5), shipped(name), materials=grass) as simulation:
        before = simulation.vehicle_states()[NAME].poses()[0].copy()
        stood = drive(simulation, 8.0)
    # Settled, it leans downhill on its springs, too.
    assert STEEP_DEG - 0.1 < degrees(2 * asin(before[3])) < STEEP_DEG + 7.0
    assert np.linalg.norm(stood.pose[:, :3] - before[:3], axis=1).max() < 0.1


def test_survives_a_fall(name: str) -> None:
    with put(shipped(name), at=Placement(z_m=0.5)) as simulation:
        fallen = drive(simulation, 5.0)
    rest = shipped(name).base_height_m
    np.testing.assert_allclose(fallen.pose[-1, 2], rest, atol=2e-3)
    assert fallen.pose[:, 2].min() > 0.3 * rest
    assert np.abs(fallen.pose[-1, 3:5]).max() < 0.01
    assert np.abs(fallen.velocity[-1]).max() < 0.01


def test_survives_a_wall_at_full_speed(name: str) -> None:
    model = shipped(name)
    top = model.top_speed_mps
    way = 1.3 * top * acceleration_s(name, top)
    with put(model, wall(0.0), at=Placement(x_m=-way - 8.0)) as simulation:
        hit = drive(simulation, 2.5 * acceleration_s(name, top) + 10.0 / top + 1.0, (top, 0.0))
        after = drive(simulation, 4.0)
    assert hit.velocity[:, 0].max() > 0.7 * top, "was not fast"
    assert hit.pose[:, 0].max() < 0.0, "is in the wall"
    assert after.pose[-1, 2] == pytest.approx(model.base_height_m, abs=0.1)
    assert after.speed < 0.01


def test_random_commands_on_rubble_break_nothing(name: str) -> None:
    random = np.random.default_rng(1)
    top = min(shipped(name).top_speed_mps, 5.0)
    twist, rows = STILL, []
    with put(shipped(name), *rubble(0)) as simulation:
        for tick in range(round(ROUGH_SECONDS * 400)):
            if tick % 800 == 0:
                way = random.choice([-1.0, 1.0, 1.0]) * random.uniform(0.2, 1.0)
                twist = top * way, random.uniform(-1.0, 1.0)
            if tick % 20 == 0:
                stamp = simulation.sim_nanos
                simulation.command(NAME, Command(stamp, (twist[0], 0.0, 0.0), (0.0, 0.0, twist[1])))
            simulation.step()
            if tick % 8 == 0:
                state = simulation.vehicle_states()[NAME]
                rows.append(
                    np.concatenate(
                        (
                            state.poses()[0, :3],
                            floats(state.base_velocity),
                            floats(state.joint_velocities),
                        )
                    )
                )
    history = np.array(rows)
    assert np.isfinite(history).all()
    assert np.abs(history[:, :2]).max() < 18.0, "left the world"
    assert history[:, 2].min() > -1.0, "fell through the ground"
    assert history[:, 2].max() < 5.0, "was thrown up"
    assert np.abs(history[:, 3:6]).max() < 3 * top + 3.0
    assert np.ptp(history[:, :2], axis=0).max() > 2.0, "did not move"


def test_same_calls_give_the_same_bytes(name: str) -> None:
    def played() -> list[bytes]:
        with put(shipped(name), *rubble(0)) as simulation:
            return [
                encode(State("", 0, 0, 0, 0, "", simulation.vehicle_states()))
                for _ in range(20)
                if len(drive(simulation, 0.1, (1.0, 0.5)).pose)
            ]

    assert played() == played()
