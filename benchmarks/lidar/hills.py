# SPDX-License-Identifier: Apache-2.0
"""A hilly terrain of a million triangles with bodies that drive and turn on it, as no scenario has.

The LiDAR's own vehicle is one of the bodies. Their states are made here, and the scene of the model
is replaced by one of this terrain; everything else is what a run does.
"""

from collections.abc import Iterator

import msgspec
import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.frames import Floats
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import State, VehicleState, packed
from groundlink.scenario.schema import Scenario
from groundlink.world.terrain import Ground
from groundlink.world.triangles import Triangles, merged, of_ground
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.rays.scene import Scene
from services.sensors.rays.terrain import Relief

SIDE_M = 200.0
POINTS = 724
"""A side: 2 x 723 x 723 = 1,045,458 triangles, 0.28 m from point to point."""

HALF_AXES_M = (1.5, 0.8, 0.6)
"""Of a body, an ellipsoid of 1,280 triangles."""

NEAREST_M, FARTHEST_M = 4.0, 60.0
SPEED_MPS, TURN_RADPS = 3.0, 2.0
LINKS = 5
"""Of each vehicle: its base and four wheels, which are as good bodies as any."""


def height_m(x: Floats, y: Floats) -> Floats:
    """Return the terrain's height."""
    hills = 1.2 * np.sin(x / 7) * np.cos(y / 9) + 0.1 * np.sin(1.3 * x) * np.sin(1.1 * y)
    return np.asarray(hills)


def ground() -> Ground:
    """Return the terrain around the world's origin."""
    line = np.linspace(-SIDE_M / 2, SIDE_M / 2, POINTS)
    heights = height_m(*np.meshgrid(line, line)).astype(np.float32)
    surface = np.zeros((POINTS - 1, POINTS - 1), np.uint8)
    return Ground(heights, surface, SIDE_M / (POINTS - 1), -SIDE_M / 2, -SIDE_M / 2, ("ground",))


def ellipsoid() -> Triangles:
    """Return a body in its own frame: an icosahedron, each face cut in four three times."""
    golden = (1 + np.sqrt(5)) / 2
    corners = [(s, t * golden, 0.0) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners])
    near = np.linalg.norm(points[:, None] - points, axis=-1) < 2.1
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    triangles = points[np.array(faces)]
    inwards = np.linalg.det(triangles) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    for _ in range(3):
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        cut = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(corners, axis=1) for corners in cut])
    triangles /= np.linalg.norm(triangles, axis=-1, keepdims=True)
    vertices, faces_of = np.unique(
        np.round(triangles.reshape(-1, 3), 9), axis=0, return_inverse=True
    )
    faces_of = faces_of.reshape(-1, 3)
    return Triangles(
        (vertices * HALF_AXES_M).astype(np.float32),
        faces_of.astype(np.uint32),
        np.zeros(len(faces_of), np.int32),
    )


class Hills:
    """The scenario, its states, and LiDARs in it."""

    def __init__(self, ground: Ground, bodies: int) -> None:
        self._ground, self.body, self.bodies = ground, ellipsoid(), bodies
        self.scenario = _scenario(bodies // LINKS)
        generator = np.random.default_rng(3)
        away = generator.uniform(NEAREST_M, FARTHEST_M, bodies)
        away[0] = 0
        angle = generator.uniform(0, 2 * np.pi, bodies)
        self._start = np.stack([away * np.cos(angle), away * np.sin(angle)], axis=-1)
        self._heading = generator.uniform(0, 2 * np.pi, bodies)

    def poses(self, tick: int) -> Floats:
        """Return world_from_body, shape (bodies, 7)."""
        turned = self._heading + TURN_RADPS * tick * TICK_SECONDS
        ahead = np.stack(
            [np.sin(turned) - np.sin(self._heading), np.cos(self._heading) - np.cos(turned)],
            axis=-1,
        )
        x, y = (self._start + SPEED_MPS / TURN_RADPS * ahead).T
        poses = np.zeros((self.bodies, 7))
        poses[:, 0], poses[:, 1], poses[:, 2] = x, y, height_m(x, y) + HALF_AXES_M[2]
        poses[:, 5], poses[:, 6] = np.sin(turned / 2), np.cos(turned / 2)
        return poses

    def motion(self, states: int) -> Floats:
        """Return the poses of the first ticks, shape (states, bodies, 7)."""
        return np.stack([self.poses(tick) for tick in range(states)])

    def states(self) -> Iterator[State]:
        """Yield the states of a run."""
        none, tick = packed(np.zeros(0)), 0
        while True:
            poses = self.poses(tick).reshape(-1, LINKS, 7)
            vehicles = {
                vehicle.name: VehicleState(packed(own), packed(np.zeros(6)), none, none)
                for vehicle, own in zip(self.scenario.vehicles, poses, strict=True)
            }
            yield State("benchmark", 0, 0, tick, tick * TICK_NANOS, "", vehicles)
            tick += 1

    def lidar(self, spec: Lidar, *, as_heights: bool = False) -> LidarModel:
        """Return the model of a LiDAR on the first vehicle, above its body."""
        mount = msgspec.structs.replace(spec.mount, xyz_m=(0.0, 0.0, HALF_AXES_M[2] + 0.6))
        spec = msgspec.structs.replace(spec, mount=mount)
        model = LidarModel(self.scenario, self.scenario.vehicles[0], spec)
        bodies = [self.body] * self.bodies
        if as_heights:
            scene = Scene(merged([]), bodies, terrain=Relief(self._ground, first_label=0))
        else:
            scene = Scene(of_ground(self._ground, first_label=0), bodies)
        model.scanner.replica.scene = scene
        return model


def _scenario(vehicles: int) -> Scenario:
    """Return a scenario of many vehicles in a minimal world."""
    lab = load(SHIPPED / "indoor_lab.yaml")
    rover = lab.vehicles[0]
    wheels = rover.model.wheels[: LINKS - 1]
    model = msgspec.structs.replace(rover.model, wheels=wheels, visuals=(), collisions=())
    return msgspec.structs.replace(
        lab,
        world=msgspec.structs.replace(lab.world, furniture=(), clutter=None),
        vehicles=tuple(
            msgspec.structs.replace(
                rover,
                name=f"rover{i}",
                model=model,
                placement=msgspec.structs.replace(rover.placement, x_m=100.0 + 10.0 * i),
            )
            for i in range(vehicles)
        ),
    )
