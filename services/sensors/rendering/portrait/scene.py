# SPDX-License-Identifier: Apache-2.0
"""The scene of a portrait: what it shows of a world, vehicle or scenario, and its frames.

Everything is as at the start of a run. The ceiling, the walls towards the eye and the weather are
left out, so that they hide nothing.
"""

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from groundlink.core.frames import Floats, multiply, transform
from groundlink.loader.partial_scenario import FileKind
from groundlink.scenario.joints import base_from_links
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scene.bodies import link_solids
from groundlink.scene.build import solids
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world import actor_motion as motion
from groundlink.world.actors import form_solids
from groundlink.world.bounds import bounds
from groundlink.world.objects.indoor_objects import WALLS
from groundlink.world.solids import Box, Solid
from groundlink.world.terrain import Ground, load_ground
from groundlink.world.weather import Weather
from services.sensors.rendering.gl.culling import Boxes

FLOOR = 17.0
"""Side of the floor under a vehicle, in lengths of the vehicle's longest side."""

CLEAR_M = 1e7
"""Visibility in meters."""

AXES = {FileKind.VEHICLE: 0.15, FileKind.WORLD: 0.06, FileKind.SCENARIO: 0.06}
"""Length of the frames' axes, as a share of the diagonal of the scene."""


@dataclass(frozen=True)
class NamedFrame:
    """A frame to be drawn."""

    name: str
    world_from_frame: Floats
    """world_from_frame, shape (4, 4)."""

    def ends(self, axis_m: float) -> Floats:
        """Return the frame's origin and the ends of its axes in the world, shape (4, 3)."""
        origin, axes = self.world_from_frame[:3, 3], self.world_from_frame[:3, :3]
        return np.vstack([origin, origin + axis_m * axes.T])


@dataclass(frozen=True)
class PortraitScene:
    """The visible objects of a portrait (`stage.Things`)."""

    world: World
    static: tuple[Solid, ...]
    links: list[list[Solid]]
    movers: list[str]
    poses: Floats
    """world_from_link, shape (links, 7)."""

    corners: Floats
    """Points around everything that should be in the picture, shape (N, 3)."""

    frames: list[NamedFrame]
    axis_m: float
    """Length of the frames' axes, meters."""


def scene(kind: FileKind, scenario: Scenario, towards_eye: Floats) -> PortraitScene:
    """Return what a portrait shows from a direction, a unit vector in the world."""
    terrain = load_ground(scenario.world.terrain) if scenario.world.terrain else None
    built, names, poses, frames = [], [], [np.empty((0, 7))], []
    if kind is not FileKind.VEHICLE:
        frames.append(NamedFrame("world", np.eye(4)))
    for vehicle in scenario.vehicles:
        there = link_solids(vehicle.model)
        built += there
        names += [vehicle.name] * len(there)
        poses.append(_standing(vehicle, terrain))
        frames += _frames(vehicle, poses[-1], alone=kind is FileKind.VEHICLE)
    for actor in scenario.world.actors:
        place = motion.initial_pose(actor.motion, terrain)
        built.append(form_solids(actor.form))
        names.append(actor.name)
        poses.append(np.array([[*place.position_m, *place.orientation]]))
    world_from_link = np.concatenate(poses)
    static = _open(scenario, towards_eye)
    around = [
        *_outline(scenario.world, static),
        *(
            _corners([solid]) @ matrix[:3, :3].T + matrix[:3, 3]
            for part, matrix in zip(
                built, transform(world_from_link[:, :3], world_from_link[:, 3:]), strict=True
            )
            for solid in part
        ),
    ]
    size_m = np.ptp(np.concatenate(around), axis=0)
    axis_m = AXES[kind] * float(np.linalg.norm(size_m))
    around += [frame.ends(axis_m) for frame in frames if kind is FileKind.VEHICLE]
    if kind is FileKind.VEHICLE:
        floor = Box(size_m=(FLOOR * size_m.max(), FLOOR * size_m.max(), 0.1))
        static = (Solid("floor", floor, "floor", position_m=(0.0, 0.0, -0.05)),)
    return PortraitScene(
        world=replace(scenario.world, weather=Weather(fog_visibility_m=CLEAR_M)),
        static=static,
        links=built,
        movers=names,
        poses=world_from_link,
        corners=np.concatenate(around),
        frames=frames,
        axis_m=axis_m,
    )


def _standing(vehicle: Vehicle, terrain: Ground | None) -> Floats:
    """Return world_from_link of a vehicle at rest on its springs at its start, shape (links, 7)."""
    position, turn = spawn_pose(vehicle, terrain)
    base = transform(position, turn)
    joints = vehicle.model.joints
    still = (place for place, _ in base_from_links(joints, [0.0] * len(joints)))
    wheels = (wheel.center_m for wheel in vehicle.model.wheels)
    arms = (arm.pivot_m for arm in vehicle.model.arms)
    in_base = np.array([(0.0, 0.0, 0.0), *wheels, *still, *arms])
    positions = in_base @ base[:3, :3].T + base[:3, 3]
    turns = np.tile(turn, (len(positions), 1))
    for i, wheel in enumerate(vehicle.model.wheels):
        if wheel.yaw_rad:
            half = wheel.yaw_rad / 2
            turns[1 + i] = multiply(turn, (0.0, 0.0, np.sin(half), np.cos(half)))
    return np.hstack([positions, turns])


def _frames(vehicle: Vehicle, links: Floats, *, alone: bool) -> list[NamedFrame]:
    """Return the frames of a vehicle: base and mounts if it is alone, otherwise its base only."""
    base = links[0]
    if not alone:
        return [NamedFrame(vehicle.name, transform(base[:3], base[3:]))]
    mounts = [
        NamedFrame(
            name,
            transform(at[:3], at[3:]) @ transform(mount.xyz_m, mount.quaternion()),
        )
        for name, mount in vehicle.model.mounts.items()
        for at in (links[vehicle.model.link_of(mount)],)
    ]
    return [NamedFrame(vehicle.model.base_frame, transform(base[:3], base[3:])), *mounts]


def _open(scenario: Scenario, towards_eye: Floats) -> tuple[Solid, ...]:
    """Return the static solids without the ceiling and the walls towards the eye."""
    hidden = ["room_ceiling"]
    for name, (yaw_deg, _) in WALLS.items():
        yaw = np.radians(yaw_deg)
        outwards = np.array([-np.sin(yaw), np.cos(yaw)])
        if outwards @ towards_eye[:2] > 1e-6:
            hidden.append(f"wall_{name}")
            door = scenario.world.room and scenario.world.room.door
            if door and door.wall == name:
                hidden.append("door_leaf")
    own = {solid.name for solid in scenario.world.solids}
    shown = []
    for solid in solids(scenario):
        if scenario.world.room and solid.name not in own:
            if solid.name.startswith(tuple(hidden)):
                continue
            if solid.name == "room_floor":
                # The floor continues outside of the room, where nothing is visible.
                length, width, _ = scenario.world.room.size_m
                thick = scenario.world.room.wall_thickness_m
                size = (length + 2 * thick, width + 2 * thick, thick)
                solid = replace(solid, shape=Box(size_m=size))
        shown.append(solid)
    return tuple(shown)


def _outline(world: World, static: tuple[Solid, ...]) -> list[Floats]:
    """Return points around static solids and the terrain."""
    around = [_corners(list(static))]
    if world.terrain:
        low, high = np.array(world.terrain.low_m), np.array(world.terrain.high_m)
        around.append(Boxes.around(low[None], high[None]).corners().reshape(-1, 3))
    return around


def _corners(some: list[Solid]) -> Floats:
    """Return the corners of the boxes around solids, shape (8 N, 3)."""
    lows, highs = (np.reshape([bounds(solid)[i] for solid in some], (-1, 3)) for i in (0, 1))
    return Boxes.around(lows, highs).corners().reshape(-1, 3)
