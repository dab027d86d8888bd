# SPDX-License-Identifier: Apache-2.0
"""A LiDAR revolution against PyBullet's rayTestBatch: `python -m benchmarks.lidar`.

Rule: the same rays in the same room. Ours is timed from the states of a revolution to its finished
cloud (poses, rays, noise, records) while the vehicle drives a curve, with the threads that it uses;
PyBullet's is rayTestBatch alone with one thread, on rays that were made for it, each solid a body,
everything at rest, after a first step as in any running simulation (it is faster before). Turn by
turn; the figures are medians, `ratio` of the elapsed times, `cpu_ratio` of the processor's.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import pybullet

from groundlink.clock import TICK_NANOS, TICK_SECONDS, Schedule
from groundlink.frames import Floats, matrix_from_quaternion, multiply, quaternion_from_rpy
from groundlink.messages import State, VehicleState, packed
from groundlink.scenario import Scenario, load
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import Lidar
from groundlink.world.build import solids
from groundlink.world.solids import Box, Cylinder, Solid, Sphere
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.sweep import Sweep

LAB = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
WARM_UP = 2
SPEED_MPS, TURN_RADPS = 1.0, 0.5
RAYS_A_CALL = 16384
"""PyBullet's MAX_RAY_INTERSECTION_BATCH_SIZE."""


def link_poses(scenario: Scenario, tick: int) -> dict[str, Floats]:
    """Return world_from_link of every vehicle, shape (links, 7), on its way along a circle."""
    poses = {}
    for vehicle in scenario.vehicles:
        place, wheels = vehicle.placement, vehicle.model.wheels
        turned = TURN_RADPS * tick * TICK_SECONDS
        yaw, radius = np.radians(place.yaw_deg), SPEED_MPS / TURN_RADPS
        ahead = [np.sin(turned) * radius, (1 - np.cos(turned)) * radius, 0.0]
        start = matrix_from_quaternion(quaternion_from_rpy(0, 0, yaw))
        base = start @ ahead + (place.x_m, place.y_m, place.z_m + wheels[0].radius_m)
        turn = quaternion_from_rpy(0, 0, yaw + turned)
        rolled = quaternion_from_rpy(0, SPEED_MPS * tick * TICK_SECONDS / wheels[0].radius_m, 0)
        centers = np.array([wheel.center_m for wheel in wheels]) @ matrix_from_quaternion(turn).T
        poses[vehicle.name] = np.array(
            [[*base, *turn], *([*(base + c), *multiply(turn, rolled)] for c in centers)]
        )
    return poses


def state(scenario: Scenario, tick: int) -> State:
    """Return the state of all vehicles at a tick."""
    none = packed(np.zeros(0))
    vehicles = {
        name: VehicleState(packed(poses), packed(np.zeros(6)), none, none)
        for name, poses in link_poses(scenario, tick).items()
    }
    return State("benchmark", 0, tick, tick * TICK_NANOS, "", vehicles)


class Rival:
    """PyBullet with the same room, the same vehicles at rest, and the same rays.

    Attributes
    ----------
    bodies : int
    rays : int
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Lidar) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        for solid in solids(scenario):
            self._add(solid, np.array([0, 0, 0, 0, 0, 0, 1.0]))
        for other in scenario.vehicles:
            base, *wheels = link_poses(scenario, 0)[other.name]
            for visual in other.model.visuals:
                self._add(visual, base)
            for wheel, pose in zip(other.model.wheels, wheels, strict=True):
                shape = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
                axis = quaternion_from_rpy(np.pi / 2, 0, 0)
                self._add(Solid(name="wheel", shape=shape, material="", orientation=axis), pose)
        self.bodies = pybullet.getNumBodies(self._client)
        pybullet.stepSimulation(self._client)

        sweep = Sweep(spec)
        ticks = Schedule.at(spec.rotation_rate_hz).tick(1)
        poses = [link_poses(scenario, tick)[vehicle.name][0] for tick in range(ticks + 1)]
        sweep.follow(np.array(poses), 0.0, range(sweep.seconds.shape[1]))
        start = sweep.origins_in_world.reshape(3, -1).T.astype(np.float64)
        end = start + spec.max_range_m * sweep.directions_in_world.reshape(3, -1).T
        self.rays = len(start)
        self._calls = [
            (start[first : first + RAYS_A_CALL].tolist(), end[first : first + RAYS_A_CALL].tolist())
            for first in range(0, self.rays, RAYS_A_CALL)
        ]

    def _add(self, solid: Solid, world_from_frame: Floats) -> None:
        client = {"physicsClientId": self._client}
        match solid.shape:
            case Box(size_m=size):
                half = [length / 2 for length in size]
                shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **client)
            case Cylinder(radius_m=radius, length_m=length):
                shape = pybullet.createCollisionShape(
                    pybullet.GEOM_CYLINDER, radius=radius, height=length, **client
                )
            case Sphere(radius_m=radius):
                shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, **client)
        place, turn = world_from_frame[:3], world_from_frame[3:]
        pybullet.createMultiBody(
            baseCollisionShapeIndex=shape,
            basePosition=(place + matrix_from_quaternion(turn) @ solid.position_m).tolist(),
            baseOrientation=multiply(turn, solid.orientation).tolist(),
            **client,
        )

    def revolution(self) -> None:
        """Cast all rays."""
        for start, end in self._calls:
            pybullet.rayTestBatch(start, end, numThreads=1, physicsClientId=self._client)


def clocks() -> Floats:
    """Return elapsed and processor time, seconds."""
    return np.array([time.perf_counter(), time.process_time()])


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.lidar", description=__doc__)
    parser.add_argument("--check", type=float, metavar="RATIO", help="fail below this ratio")
    parser.add_argument("--scenario", type=Path, default=LAB, help="with a LiDAR in it")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    scenario = load(options.scenario)
    lidars = [(v, s) for v in scenario.vehicles for s in v.sensors if isinstance(s, Lidar)]
    if not lidars:
        parser.error(f"{options.scenario} has no LiDAR")
    vehicle, spec = lidars[0]
    rival, model = Rival(scenario, vehicle, spec), LidarModel(scenario, vehicle, spec)

    ours_s: list[Floats] = []
    rivals_s: list[Floats] = []
    tick, returns, spent = 0, 0, np.zeros(2)
    while len(ours_s) < options.rounds + WARM_UP:
        now = state(scenario, tick)
        started = clocks()
        clouds = model.readings(now)
        spent += clocks() - started
        for cloud in clouds:
            returns = len(cloud.records())
            ours_s.append(spent)
            started = clocks()
            rival.revolution()
            rivals_s.append(clocks() - started)
            spent = np.zeros(2)
        tick += 1
    ours, rivals = np.array(ours_s[WARM_UP:]), np.array(rivals_s[WARM_UP:])
    ratio, cpu_ratio = np.median(rivals / ours, axis=0)
    (ours_ms, ours_cpu_ms), (rivals_ms, _) = (1e3 * np.median(t, axis=0) for t in (ours, rivals))
    print(
        f"lidar revolution: ratio={ratio:.1f} cpu_ratio={cpu_ratio:.1f} "
        f"groundlink_ms={ours_ms:.2f} groundlink_cpu_ms={ours_cpu_ms:.2f} "
        f"pybullet_ms={rivals_ms:.1f} rays={rival.rays} bodies={rival.bodies} returns={returns}"
    )
    if options.check is not None and ratio < options.check:
        print(f"expected a ratio of at least {options.check:g}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
