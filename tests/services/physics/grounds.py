# SPDX-License-Identifier: Apache-2.0
"""Plain grounds and the shipped vehicles on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import cos, pi, radians, sin

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.frames import quaternion_from_rpy
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages.base import Command, floats
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Material, Solid
from services.physics.dynamics.backend import Backend
from services.physics.dynamics.bullet import BulletBackend
from services.physics.simulation.simulation import Simulation

VEHICLES = sorted(file.stem for file in (SHIPPED / "vehicles").glob("*.yaml"))
"""Names of all shipped vehicles."""

STEEP_DEG = 20.0
NAME = "it"
FLOOR = Solid("floor", Box(size_m=(400.0, 400.0, 1.0)), "ground", (0.0, 0.0, -0.5))


@cache
def shipped(name: str) -> VehicleModel:
    """Return a shipped vehicle's model."""
    return convert(read(SHIPPED / "vehicles" / f"{name}.yaml"), VehicleModel)


@cache
def plain_scenario() -> Scenario:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    materials = {"ground": Material(friction=1.0), "ice": Material(friction=0.1)}
    return replace(scenario, world=replace(scenario.world, materials=materials))


def put(
    model: VehicleModel,
    *extra: Solid,
    at: Placement = Placement(),  # noqa: B008 - frozen
    floor: Sequence[Solid] = (FLOOR,),
    new_backend: Callable[[], Backend] = BulletBackend,
) -> Simulation:
    """Return a simulation of one vehicle on the floor and what else is there."""
    plain = plain_scenario()
    vehicle = replace(plain.vehicles[0], name=NAME, model=model, placement=at)
    scenario = replace(plain, vehicles=(vehicle,))
    return Simulation(scenario, (*floor, *extra), new_backend=new_backend)


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
    twist: tuple[float, float] | None = None,
    name: str = NAME,
) -> Drive:
    """Step, with a command of (m/s, rad/s) a tick if one is given."""
    rows = []
    for _ in range(round(seconds * 400)):
        if twist is not None:
            command = Command(simulation.sim_nanos, (twist[0], 0.0, 0.0), (0.0, 0.0, twist[1]))
            simulation.command(name, command)
        simulation.step()
        state = simulation.vehicle_states()[name]
        base, wheels = np.split(state.poses(), [1])
        velocity, angles = floats(state.base_velocity), floats(state.joint_positions)
        rows.append((base[0], velocity, angles, wheels))
    return Drive(*(np.array(column) for column in zip(*rows, strict=True)))


def travels(model: VehicleModel, driven: Drive) -> tuple[float, float]:
    """Return how far the left and the right side have rolled, m, by what encoders count."""
    sides: dict[bool, list[float]] = {True: [], False: []}
    for shaft in model.counted:
        wheel = model.wheels[shaft.wheels[0]]
        angle = driven.angles[-1, shaft.wheels[0]] - driven.angles[0, shaft.wheels[0]]
        sides[wheel.center_m[1] > 0].append(angle * wheel.radius_m)
    return float(np.mean(sides[True])), float(np.mean(sides[False]))


def slope(
    x_m: float, *, degrees: float = STEEP_DEG, length_m: float = 40.0, material: str = "ground"
) -> list[Solid]:
    """Return a slope up along x, from `x_m` on, that a long vehicle can drive on to: by steps."""
    slabs = []
    z_m = 0.0
    for i, (share, piece_m) in enumerate(
        ((0.2, 1.5), (0.4, 1.5), (0.6, 1.5), (0.8, 1.5), (1.0, length_m))
    ):
        pitch = radians(share * degrees)
        c, s = cos(pitch), sin(pitch)
        middle = (x_m + piece_m / 2 * c + s / 2, 0.0, z_m + piece_m / 2 * s - c / 2)
        shape = Box(size_m=(piece_m, 12.0, 1.0))
        slabs.append(
            Solid(f"slope_{i}", shape, material, middle, quaternion_from_rpy(0.0, -pitch, 0.0))
        )
        x_m, z_m = x_m + piece_m * c, z_m + piece_m * s
    return slabs


def wall(x_m: float) -> Solid:
    """Return a wall across x, its near face there."""
    return Solid("wall", Box(size_m=(0.2, 40.0, 3.0)), "ground", (x_m + 0.1, 0.0, 1.5))


def rubble(seed: int, *, half_m: float = 15.0, count: int = 250) -> list[Solid]:
    """Return slabs that lie about tilted, with a wall around them; the middle is free."""
    random = np.random.default_rng(seed)
    slabs: list[Solid] = []
    while len(slabs) < count:
        x, y = random.uniform(-half_m, half_m, 2).tolist()
        length, width, depth = random.uniform((1, 1, 0), (4, 4, 0.2)).tolist()
        roll, pitch, yaw = (random.uniform(-1, 1, 3) * [0.35, 0.35, pi]).tolist()
        if np.hypot(x, y) > 6.0 and abs(roll) + abs(pitch) > 0.05:
            slabs.append(
                Solid(
                    f"slab_{len(slabs)}",
                    Box(size_m=(length, width, 0.5)),
                    "ground",
                    (x, y, -0.15 - depth),
                    quaternion_from_rpy(roll, pitch, yaw),
                )
            )
    for i in range(4):
        c, s = cos(i * pi / 2), sin(i * pi / 2)
        shape = Box(size_m=(1.0, 2 * half_m + 6.0, 8.0))
        middle = ((half_m + 2.5) * c, (half_m + 2.5) * s, 3.0)
        slabs.append(
            Solid(f"wall_{i}", shape, "ground", middle, quaternion_from_rpy(0.0, 0.0, i * pi / 2))
        )
    return slabs
