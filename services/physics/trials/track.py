# SPDX-License-Identifier: Apache-2.0
"""Test track: a level floor with one vehicle on it, and what else is put there."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import Command, floats
from groundlink.scenario.running_gear import Omnidirectional
from groundlink.scenario.schema import Placement, Scenario, Vehicle, World
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Material, Solid
from services.physics.dynamics.backend import Backend
from services.physics.dynamics.bullet import BulletBackend
from services.physics.simulation.simulation import Simulation, SimulationMemory

NAME = "it"
"""Name of the vehicle on the track."""

MATERIALS = {"ground": Material(friction=1.0), "ice": Material(friction=0.1)}
FLOOR_M = 400.0
FLOOR = Solid("floor", Box(size_m=(FLOOR_M, FLOOR_M, 1.0)), "ground", (0.0, 0.0, -0.5))


def put(
    model: VehicleModel,
    *extra: Solid,
    at: Placement = Placement(),  # noqa: B008 - frozen
    floor: Sequence[Solid] = (FLOOR,),
    materials: Mapping[str, Material] = MATERIALS,
    memory: SimulationMemory | None = None,
    new_backend: Callable[[], Backend] = BulletBackend,
) -> Simulation:
    """Return a simulation of one vehicle on the floor and what else is there."""
    scenario = Scenario(
        name="track",
        world=World(name="track", materials={**materials}),
        vehicles=(Vehicle(name=NAME, model=model, placement=at),),
    )
    return Simulation(scenario, (*floor, *extra), new_backend=new_backend, memory=memory)


@dataclass(frozen=True)
class Drive:
    """A row a tick: base pose and velocity in the world, angles of all wheels, their poses."""

    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angles: NDArray[np.float64]
    wheels: NDArray[np.float64]

    @property
    def last(self) -> NDArray[np.float64]:
        """The base's pose at the end."""
        pose: NDArray[np.float64] = self.pose[-1]
        return pose

    @property
    def speed(self) -> float:
        """Over ground at the end, m/s."""
        return float(np.hypot(*self.velocity[-1, :2]))


def drive(
    simulation: Simulation,
    seconds: float,
    twist: tuple[float, ...] | None = None,
    name: str = NAME,
) -> Drive:
    """Step, with a command of (m/s, rad/s), or also m/s to the left, a tick if one is given."""
    rows = []
    for _ in range(round(seconds * TICK_RATE_HZ)):
        if twist is not None:
            forward, turn, left = twist if len(twist) == 3 else (*twist, 0.0)
            command = Command(simulation.sim_nanos, (forward, left, 0.0), (0.0, 0.0, turn))
            simulation.command(name, command)
        simulation.step()
        state = simulation.vehicle_states()[name]
        base, wheels = np.split(state.poses(), [1])
        velocity, angles = floats(state.base_velocity), floats(state.joint_positions)
        rows.append((base[0], velocity, angles, wheels))
    return Drive(*(np.array(column) for column in zip(*rows, strict=True)))


def rolled(model: VehicleModel, driven: Drive) -> tuple[float, float, float]:
    """Return how far a base with rollers has moved along its x and y (m) and turned (rad).

    By what encoders count, on a way whose directions stay the same in the base.
    """
    assert isinstance(model.drive, Omnidirectional)
    shafts = [shaft.wheels[0] for shaft in model.counted]
    angles = driven.angles[-1, shafts] - driven.angles[0, shafts]
    moved = np.linalg.lstsq(np.array(model.drive.rows(model.wheels)), angles)[0]
    forward, left, turn = moved.tolist()
    return forward, left, turn


def travels(model: VehicleModel, driven: Drive) -> tuple[float, float]:
    """Return how far the left and the right side have rolled, m, by what encoders count."""
    sides: dict[bool, list[float]] = {True: [], False: []}
    for shaft in model.counted:
        wheel = model.wheels[shaft.wheels[0]]
        angle = driven.angles[-1, shaft.wheels[0]] - driven.angles[0, shaft.wheels[0]]
        sides[wheel.center_m[1] > 0].append(angle * wheel.radius_m)
    return float(np.mean(sides[True])), float(np.mean(sides[False]))


def ramp(degrees: float, length_m: float) -> Iterator[tuple[float, float]]:
    """Yield the pitch (rad) and the length (m) of the pieces of a ground that gets steeper."""
    for share in (0.2, 0.4, 0.6, 0.8):
        yield radians(share * degrees), 1.5
    yield radians(degrees), length_m


def slope(
    x_m: float, *, degrees: float, length_m: float = 40.0, material: str = "ground"
) -> list[Solid]:
    """Return a slope up along x, from `x_m` on, that a long vehicle can drive on to: by steps."""
    slabs = []
    z_m = 0.0
    for i, (pitch, piece_m) in enumerate(ramp(degrees, length_m)):
        c, s = cos(pitch), sin(pitch)
        middle = (x_m + piece_m / 2 * c + s / 2, 0.0, z_m + piece_m / 2 * s - c / 2)
        shape = Box(size_m=(piece_m, 12.0, 1.0))
        slabs.append(
            Solid(f"slope_{i}", shape, material, middle, quaternion_from_rpy(0.0, -pitch, 0.0))
        )
        x_m, z_m = x_m + piece_m * c, z_m + piece_m * s
    return slabs
