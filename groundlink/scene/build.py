# SPDX-License-Identifier: Apache-2.0
"""World builder: computes a scenario's static solids and the world hash.

Physics and every replica build the world independently and compare hashes. The result must
therefore be identical to the bit on every machine. Vehicles are not part of the built solids.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from zlib import crc32

import msgspec
import numpy as np

from groundlink.core.errors import UserError, did_you_mean
from groundlink.scenario.schema import Scenario, World
from groundlink.scenario.vehicle import EFFECTS, VehicleModel
from groundlink.world import terrain
from groundlink.world.actors import CrateForm, DoorForm, Form, PartsForm, PersonForm
from groundlink.world.bounds import Bounds, bounds
from groundlink.world.objects.clutter import NoFreePlace, place_clutter
from groundlink.world.objects.indoor_objects import build_furniture, build_room, door_frame
from groundlink.world.objects.indoor_specs import Room
from groundlink.world.objects.local_frame import LocalFrame, SupportSurface
from groundlink.world.objects.outdoor_objects import build_outdoor_object
from groundlink.world.solids import Box, Solid

from .bodies import link_bodies
from .spawn_pose import spawn_pose

STRIP_M = 0.45
"""Width of the strip of floor along the walls in which clutter is placed."""

SPAWN_CLEARANCE_M = 0.5
"""Clearance between clutter and a vehicle's chassis at its spawn place."""

Path = tuple[str | int, ...]

OF_PHYSICS = (*EFFECTS, "wading")
"""Fields of a vehicle model that physics alone reads."""

_CANONICAL = msgspec.msgpack.Encoder(order="deterministic")


class WorldError(UserError):
    """Error of a world that cannot be built.

    Attributes
    ----------
    path
        keys and indices from the scenario to the invalid field.
    """

    def __init__(self, path: Path, problem: str) -> None:
        field = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
        super().__init__(f"`{field.removeprefix('.')}`: {problem}")
        self.path = path


class UnknownMaterial(WorldError):
    """Error for a material that the world does not define."""

    def __init__(self, path: Path, material: str, known: Iterable[str]) -> None:
        hint = did_you_mean(material, known)
        super().__init__(path, f"no material `{material}` in world.materials; {hint}")
        self.material = material


def solids(scenario: Scenario) -> tuple[Solid, ...]:
    """Return all static solids of a scenario's world, in the world's frame, without its terrain.

    Raises
    ------
    WorldError
        when a material is not in `world.materials` (`UnknownMaterial`), two bodies share a name,
        or there is no room for the clutter.
    """
    _check_materials(scenario)
    _check_cover(scenario.world)
    world = scenario.world
    surfaces: list[SupportSurface] = []
    built: list[Solid] = build_room(world.room) if world.room else []
    for index, furniture in enumerate(world.furniture):
        parts, tops = build_furniture(index, furniture)
        built += parts
        surfaces += tops
    for index, thing in enumerate(world.outdoors):
        built += build_outdoor_object(index, thing)
    built += world.solids
    if world.clutter:
        # An independent random stream: other uses of the seed must not move the clutter.
        generator = np.random.default_rng([scenario.seed, crc32(b"clutter")])
        if world.room:
            surfaces += _strips(world.room)
        occupied = [bounds(solid) for solid in built] + _kept_free(scenario)
        try:
            built += place_clutter(world.clutter, surfaces, occupied, generator)
        except NoFreePlace as error:
            raise WorldError(("world", "clutter", "count"), str(error)) from None
    names = {terrain.BODY} if world.terrain else set()
    for body in link_bodies(scenario):
        if body in names:
            raise WorldError(("world", "actors"), f"two bodies are named `{body}`. Fix: rename one")
        names.add(body)
    for solid in built:
        if solid.name in names:
            raise WorldError(
                ("world", "solids"), f"two bodies are named `{solid.name}`. Fix: rename one"
            )
        names.add(solid.name)
    return tuple(built)


def world_hash(scenario: Scenario) -> str:
    """Return the SHA-256, in hexadecimal, of everything that physics and sensors must agree on.

    Hashes the built solids, actors, terrain, materials, and each vehicle's model by name, as
    canonical MessagePack. Terrain and meshes count by the digests of their assets. Effects of
    vehicles, how they wade and the ground's roughness do not count: only physics reads them.
    """
    world = scenario.world
    content = (
        solids(scenario),
        world.actors,
        world.terrain,
        world.materials,
        {vehicle.name: _agreed(vehicle.model) for vehicle in scenario.vehicles},
        *([world.water, world.grass] if world.water or world.grass else []),
    )
    return hashlib.sha256(_CANONICAL.encode(content)).hexdigest()


def _agreed(model: VehicleModel) -> msgspec.Struct:
    """Return the part of a vehicle model that physics and sensors must agree on."""
    return _reduced(
        model, without=OF_PHYSICS, wheels=tuple(_reduced(wheel) for wheel in model.wheels)
    )


def _reduced(spec: msgspec.Struct, without: Sequence[str] = (), **other: object) -> msgspec.Struct:
    """Return a structure without some fields and without those that are unset.

    The encoding of 16 fields begins with other bytes than that of 15, even if some are unset.
    """
    found = {name: getattr(spec, name) for name in spec.__struct_fields__ if name not in without}
    kept = {name: value for name, value in (found | other).items() if value is not msgspec.UNSET}
    return _structure(tuple(kept))(*kept.values())


@lru_cache
def _structure(fields: tuple[str, ...]) -> type[msgspec.Struct]:
    return msgspec.defstruct("_Reduced", fields)


def _check_materials(scenario: Scenario) -> None:
    for path, material in material_uses(scenario):
        if material not in scenario.world.materials:
            raise UnknownMaterial(path, material, scenario.world.materials)


def _check_cover(world: World) -> None:
    """Refuse water and grass without terrain, and grass on ground that there is not."""
    if world.terrain is None:
        for field in ("water", "grass"):
            if getattr(world, field):
                raise WorldError(("world", field), "expected `terrain` in this world")
        return
    for i, area in enumerate(world.grass):
        for j, name in enumerate(area.ground):
            if name not in world.terrain.materials:
                raise WorldError(
                    ("world", "grass", i, "ground", j),
                    f"no ground of `{name}`; {did_you_mean(name, world.terrain.materials)}",
                )


def material_uses(scenario: Scenario) -> Iterator[tuple[Path, str]]:
    """Yield every use of a material: its path in the scenario, and its name."""
    world = scenario.world
    if room := world.room:
        yield ("world", "room", "wall_material"), room.wall_material
        yield ("world", "room", "floor_material"), room.floor_material
        if room.door:
            yield ("world", "room", "door", "material"), room.door.material
    if world.terrain:
        for i, material in enumerate(world.terrain.materials):
            yield ("world", "terrain", "materials", i), material
    for field in ("water", "grass"):
        for i, area in enumerate(getattr(world, field)):
            yield ("world", field, i, "material"), area.material
    for i, furniture in enumerate(world.furniture):
        yield ("world", "furniture", i, "material"), furniture.material
    for i, thing in enumerate(world.outdoors):
        for field in thing.__struct_fields__:
            if field.endswith("material"):
                yield ("world", "outdoors", i, field), getattr(thing, field)
    if isinstance(world.roughness, dict):
        for material in world.roughness:
            yield ("world", "roughness", material), material
    for i, solid in enumerate(world.solids):
        yield ("world", "solids", i, "material"), solid.material
    for i, actor in enumerate(world.actors):
        for at, material in _of_form(actor.form):
            yield ("world", "actors", i, "form", *at), material
    if world.clutter:
        for i, material in enumerate(world.clutter.materials):
            yield ("world", "clutter", "materials", i), material
    for v, vehicle in enumerate(scenario.vehicles):
        for i, visual in enumerate(vehicle.model.visuals):
            yield ("vehicles", v, "model", "visuals", i, "material"), visual.material
        for i, wheel in enumerate(vehicle.model.wheels):
            yield ("vehicles", v, "model", "wheels", i, "material"), wheel.material
            for j, visual in enumerate(wheel.visuals):
                path = ("vehicles", v, "model", "wheels", i, "visuals", j, "material")
                yield path, visual.material
        for i, joint in enumerate(vehicle.model.joints):
            for j, visual in enumerate(joint.visuals):
                path = ("vehicles", v, "model", "joints", i, "visuals", j, "material")
                yield path, visual.material
        for i, arm in enumerate(vehicle.model.arms):
            for j, visual in enumerate(arm.visuals):
                at = ("vehicles", v, "model", "linkage", "arms", i, "visuals", j, "material")
                yield at, visual.material


def _of_form(form: Form) -> Iterator[tuple[Path, str]]:
    match form:
        case PartsForm(parts=parts):
            for i, part in enumerate(parts):
                yield ("parts", i, "material"), part.material
        case PersonForm():
            for field in ("shirt", "trousers", "skin"):
                yield (field,), getattr(form, field)
        case DoorForm() | CrateForm():
            yield ("material",), form.material


def _strips(room: Room) -> list[SupportSurface]:
    """Return the floor along the four walls as surfaces about one meter long.

    Each surface is chosen with equal probability, so a wall is chosen in proportion to its length.
    """
    length, width, height = room.size_m
    floor = LocalFrame("floor")
    strips = []
    for along, across, yaw_deg in ((length, width, 0.0), (width - 2 * STRIP_M, length, 90.0)):
        count = max(1, round(along))
        for side in (1, -1):
            for piece in range(count):
                frame = LocalFrame(floor.name, yaw_deg=yaw_deg)
                at = ((piece + 0.5) / count - 0.5) * along, side * (across - STRIP_M) / 2, 0.0
                strips.append(frame.surface(at, along / count, STRIP_M, height))
    return strips


def _kept_free(scenario: Scenario) -> list[Bounds]:
    """Return the boxes without clutter: around spawn places and inside the door."""
    keep = []
    for vehicle in scenario.vehicles:
        chassis = vehicle.model.chassis
        reach = math.hypot(*chassis.size_m[:2]) / 2 + math.hypot(*chassis.center_m[:2])
        at, to = np.array(spawn_pose(vehicle, None)[0]), np.full(3, reach + SPAWN_CLEARANCE_M)
        keep.append((at - to, at + to))
    room = scenario.world.room
    if room and room.door:
        door = room.door
        way = Box(size_m=(door.width_m, 2 * door.width_m, door.height_m))
        keep.append(bounds(door_frame(room, door).put("way", way, (0, 0, door.height_m / 2), "")))
    return keep
