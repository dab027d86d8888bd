# SPDX-License-Identifier: Apache-2.0
"""Additions to a running scenario: a named object, a vehicle or the contents of a world file.

The origin of the addition is put on the ground at the given place.
"""

import re
from collections.abc import Collection
from math import cos, isnan, radians, sin
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import matrix_from_quaternion, multiply
from groundlink.importing.file_errors import Warn, ignore_warning
from groundlink.scenario.additions import Addition
from groundlink.scenario.schema import Placement, Scenario, World
from groundlink.scene.bodies import link_bodies
from groundlink.scene.build import solids
from groundlink.scene.spawn_checks import ground_of
from groundlink.world import actors
from groundlink.world.solids import Box, Cylinder, Material, Solid
from groundlink.world.terrain import Ground

from .document import ScenarioError, read
from .partial_scenario import FileKind, load_partial, partial_file

_MATERIALS = {
    "cardboard": Material(reflectivity=0.5, friction=0.6, color=(0.45, 0.30, 0.16)),
    "steel": Material(reflectivity=0.4, friction=0.5, color=(0.10, 0.22, 0.45)),
    "cloth": Material(reflectivity=0.4, friction=0.8, color=(0.50, 0.05, 0.04)),
    "denim": Material(reflectivity=0.3, friction=0.8, color=(0.05, 0.08, 0.20)),
    "skin": Material(reflectivity=0.5, friction=0.8, color=(0.60, 0.38, 0.28)),
}
_CUBE = Solid("box", Box(size_m=(0.5, 0.5, 0.5)), "cardboard", (0.0, 0.0, 0.25))
_DRUM = Solid("barrel", Cylinder(radius_m=0.29, length_m=0.88), "steel", (0.0, 0.0, 0.44))
_FIGURE = actors.form_solids(actors.PersonForm(shirt="cloth", trousers="denim", skin="skin"))
_CRATE = actors.Actor(
    name="crate",
    form=actors.CrateForm(material="cardboard"),
    motion=actors.FreeMotion(at_m=(0.0, 0.0, 0.0), mass_kg=10.0),
)

KINDS: dict[str, Addition] = {
    "box": Addition(solids=(_CUBE,), materials=_MATERIALS),
    "barrel": Addition(solids=(_DRUM,), materials=_MATERIALS),
    "person": Addition(solids=tuple(_FIGURE), materials=_MATERIALS),
    "crate": Addition(actors=(_CRATE,), materials=_MATERIALS),
}
"""Named objects that need no file."""


class SpawnPlace(NamedTuple):
    """Spawn place in the world: x, y, height above the ground, and heading."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0


def check_addition(given: str) -> None:
    """Refuse an unknown name or file with a `UserError`, before the run is contacted."""
    if given not in KINDS:
        read(partial_file(given, KINDS))


def addition(
    given: str,
    *,
    at: SpawnPlace,
    name: str | None,
    taken: Collection[str],
    ground: Ground | None,
    warn: Warn = ignore_warning,
) -> tuple[str, Addition]:
    """Return the addition of a named object or file at a place, and its name.

    Parameters
    ----------
    given
        one of `KINDS`, or a vehicle or world as `load_partial` takes it.
    name
        name of a single object, or prefix of several. None: derived from `given`, with a number if
        taken.

    Raises
    ------
    UserError
        when it is nothing that can be added to a run.
    """
    called, more = content_of(given, warn)
    if name is None:
        name = free_name(called, taken)
    return name, placed(more, name, at, ground)


def content_of(given: str, warn: Warn = ignore_warning) -> tuple[str, Addition]:
    """Return the own name of an object or file that `addition` takes, and its contents.

    Raises
    ------
    UserError
        when it is nothing that can be added to a run.
    """
    if given in KINDS:
        return given, KINDS[given]
    kind, part = load_partial(given, words=KINDS, warn=warn)
    if kind is FileKind.SCENARIO:
        raise ScenarioError(
            f"`{given}`: a scenario; expected a vehicle, or a world with `solids` or `actors`"
        )
    called = part.vehicles[0].model.name if part.vehicles else part.world.name
    return called, _of(part, given)


def addition_to(
    scenario: Scenario,
    given: str,
    *,
    at: SpawnPlace,
    name: str | None,
    warn: Warn = ignore_warning,
) -> tuple[str, Addition]:
    """Return an addition to the scenario of a run, and its name; see `addition`."""
    names = [vehicle.name for vehicle in scenario.vehicles]
    names += [solid.name for solid in solids(scenario)]
    taken = [*link_bodies(scenario), *names]
    return addition(given, at=at, name=name, taken=taken, ground=ground_of(scenario), warn=warn)


def _of(part: Scenario, given: str) -> Addition:
    """Return the contents of a partial scenario as an addition."""
    world = part.world
    plain = replace(world, solids=(), actors=(), materials={}, description="", tags=())
    if not part.vehicles and plain != World(name=world.name, materials={}):
        raise ScenarioError(
            f"`{given}`: only `solids`, `actors` and `materials` of a world can be added to a run"
        )
    if not (part.vehicles or world.solids or world.actors):
        raise ScenarioError(f"`{given}`: nothing to add; expected `solids` or `actors`")
    return Addition(world.solids, world.actors, part.vehicles, world.materials)


def free_name(name: str, taken: Collection[str]) -> str:
    """Return a name, with a number if it is taken or the beginning of one that is."""

    def is_taken(one: str) -> bool:
        return any(re.match(rf"{one}(_|/|$)", other) for other in taken)

    number, free = 1, name
    while is_taken(free):
        number += 1
        free = f"{name}_{number}"
    return free


def _named(more: Addition, name: str) -> Addition:
    alone = len(more.names()) == 1

    def called(own: str) -> str:
        return name if alone else f"{name}_{own}"

    return Addition(
        tuple(replace(solid, name=called(solid.name)) for solid in more.solids),
        tuple(replace(actor, name=called(actor.name)) for actor in more.actors),
        tuple(
            replace(
                vehicle,
                name=name,
                namespace=f"/{name}",
                frame_prefix=f"{name}/",
                command_topic=f"/{name}/cmd_vel",
            )
            for vehicle in more.vehicles
        ),
        more.materials,
    )


def placed(more: Addition, name: str, at: SpawnPlace, ground: Ground | None) -> Addition:
    """Return an addition under a name, its origin on the ground at a place."""
    return _placed(_named(more, name), at, ground)


def _placed(more: Addition, at: SpawnPlace, ground: Ground | None) -> Addition:
    """Put the origin of an addition on the ground at a place."""
    height_m = 0.0 if ground is None else float(ground.height_at(at.x_m, at.y_m))
    if isnan(height_m):
        raise UserError(f"--at {at.x_m:g},{at.y_m:g} is outside the terrain")
    half = radians(at.yaw_deg) / 2
    turn = (0.0, 0.0, sin(half), cos(half))
    rotation = matrix_from_quaternion(turn)

    def put(point: Vector3, above_m: float = 0.0) -> Vector3:
        x, y, z = (rotation @ np.array(point) + at[:3]).tolist()
        return x, y, z + above_m

    def moved(actor: actors.Actor) -> actors.Actor:
        motion = actor.motion
        if isinstance(motion, actors.PathMotion):
            points = tuple(put((*point, 0.0))[:2] for point in motion.points_m)
            return replace(actor, motion=replace(motion, points_m=points, z_m=motion.z_m + at.z_m))
        assert isinstance(motion, actors.FreeMotion | actors.HingeMotion)
        yaw_deg = motion.yaw_deg + at.yaw_deg
        return replace(actor, motion=replace(motion, at_m=put(motion.at_m), yaw_deg=yaw_deg))

    place = Placement(*at)
    return Addition(
        tuple(
            replace(
                solid,
                position_m=put(solid.position_m, height_m),
                orientation=tuple(multiply(turn, solid.orientation).tolist()),
            )
            for solid in more.solids
        ),
        tuple(moved(actor) for actor in more.actors),
        tuple(replace(vehicle, placement=place) for vehicle in more.vehicles),
        more.materials,
    )
