# SPDX-License-Identifier: Apache-2.0
"""Vehicles start at rest: an IMU reads gravity from its first sample on."""

from contextlib import closing

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from groundlink.messages.base import State
from groundlink.scenario.schema import Placement
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world.solids import Material
from groundlink.world.terrain import Terrain, load_ground
from services.physics.simulation.simulation import Simulation, settled
from services.physics.trials.track import FLOOR, NAME
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit
from tests.services.physics.grounds import VEHICLES, shipped
from tests.services.physics.terrains import put, terrain, world

GRAVITY_MPS2 = 9.80665
TICKS = 200


def slope(steepness: float) -> Terrain:
    """Return a slope that rises to the east."""
    return terrain(steepness * np.arange(101)[None, :] * np.ones((101, 1)))


def off_gravity(simulation: Simulation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what an ideal IMU in the base reads beside gravity (m/s^2), and its rates (rad/s)."""
    run = world(None, (shipped("rover"), Placement()))
    model = ImuModel(run, run.vehicles[0], InertialUnit(name="imu", topic="/imu", frame="imu"))
    samples = []
    for tick in range(TICKS):
        state = State("t", 0, 0, tick, tick * 2_500_000, "", simulation.vehicle_states())
        samples += model.readings(state)
        simulation.step()
    assert len(samples) == TICKS - 2
    turned = Rotation.from_quat([sample.orientation for sample in samples])
    forces = np.array([sample.linear_acceleration_mps2 for sample in samples])
    rates = np.array([sample.angular_velocity_radps for sample in samples])
    return forces - turned.inv().apply([0.0, 0.0, GRAVITY_MPS2]), rates


@pytest.mark.parametrize("name", VEHICLES)
def test_on_a_floor_it_rests_from_the_start(name: str) -> None:
    with Simulation(world(None, (shipped(name), Placement(yaw_deg=30))), [FLOOR]) as simulation:
        forces, rates = off_gravity(simulation)
    assert np.abs(forces).max() < 0.01
    assert np.abs(rates).max() < 0.001


@pytest.mark.parametrize("yaw_deg", [0.0, 75.0, 200.0])
@pytest.mark.parametrize("steepness", [0.1, 0.25])
@pytest.mark.parametrize("name", VEHICLES)
def test_on_a_slope_it_rests_from_the_start(name: str, steepness: float, yaw_deg: float) -> None:
    at = Placement(x_m=0.37, y_m=-0.21, yaw_deg=yaw_deg)
    with put(slope(steepness), shipped(name), at=at) as simulation:
        before = simulation.vehicle_states()[NAME].poses()[0]
        forces, rates = off_gravity(simulation)
        after = simulation.vehicle_states()[NAME].poses()[0]
    # Bullet finds contacts anew in its first step; a wheel on an edge of triangles feels it.
    assert np.abs(forces[0]).max() < 0.2
    assert np.abs(forces[1:]).max() < 0.01
    assert np.abs(rates).max() < 0.001
    np.testing.assert_allclose(after, before, atol=1e-3)


def test_what_slides_starts_where_it_is_put() -> None:
    run = world(slope(0.3), (shipped("rover"), Placement()))
    assert run.world.terrain is not None
    here = load_ground(run.world.terrain)
    assert settled(run.vehicles[0], here, {"ground": Material(friction=0.01)}) is None
    assert settled(run.vehicles[0], here, {"ground": Material(friction=0.8)}) is not None


def test_what_starts_above_the_ground_falls() -> None:
    at = Placement(z_m=0.5)
    with closing(put(slope(0.1), shipped("rover"), at=at)) as simulation:
        expected, _ = spawn_pose(
            world(None, (shipped("rover"), at)).vehicles[0], simulation._terrain.ground
        )
        state = simulation.vehicle_states()[NAME].poses()[0]
        np.testing.assert_allclose(state[:3], expected, atol=1e-6)
        simulation.step()
        assert simulation.vehicle_states()[NAME].poses()[0, 2] < state[2]
