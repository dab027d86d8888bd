# SPDX-License-Identifier: Apache-2.0
"""Object labels: number, class and box of each object of a world, for labeled sensor data.

An object is what a person would point at: a vehicle with its wheels, a table with its legs, one
piece of clutter. Its class is the first tag of its description in `world.entities`; without tags it
is a vehicle's model, the kind of an actor, of furniture or of an outdoor object, or a solid's name
without its number. Each material of the terrain is a class.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from groundlink.core.errors import UserError
from groundlink.scenario.schema import Scenario
from groundlink.world import terrain
from groundlink.world.actors import form_solids

from .build import solids
from .entities import (
    ORIGIN,
    Corners,
    Pose,
    box_around,
    in_frame,
    static_entities,
    vehicle_solids,
)

NONE = 0
"""Number of no object and of no class: the sky, rain, and pixels that no light reaches."""

CLASSES = (
    *("background", "floor", "ceiling", "wall", "door", "table", "shelf", "cabinet", "chair"),
    *("pillar", "clutter", "house", "tree", "bush", "rock", "pole", "lamp", "bale", "crate"),
    *("fence", "person", "ground"),
)
"""Classes that have the same number, their index, in every world. New ones are added at the end."""

FIRST_OF_WORLD = 32
"""Number of the first class that only some worlds have; these classes are sorted by name."""

MOST_CLASSES = 255
"""One more than the largest number of a class: 8 bits without 255, which vision_msgs leaves for
unlabeled pixels."""

SURROUNDINGS = frozenset({"floor", "ceiling", "wall", "ground"})
"""Classes whose objects have no boxes, besides the terrain's."""


class LabeledObject(NamedTuple):
    """An object of a world."""

    name: str
    class_id: int
    pose: Pose
    """World from the object's frame, of a static object."""

    box_m: Corners | None
    """Box around the object in its frame; of a vehicle, in the frame of its base. None for
    surroundings."""


@dataclass(frozen=True)
class ObjectLabels:
    """All objects and classes of a world."""

    objects: tuple[LabeledObject, ...]
    """Vehicles, actors, static objects and the terrain. The number of an object is its index + 1.
    """

    classes: Mapping[str, int]
    """Number of each class, sorted by number."""

    number_of: Mapping[str, int]
    """Number of each object, by name."""

    number_of_solid: Mapping[str, int]
    """Number of the object that a static solid belongs to, by the solid's name."""

    soils: tuple[int, ...]
    """Classes of the terrain's materials, and of its water and grass."""


def object_labels(scenario: Scenario) -> ObjectLabels:
    """Return the objects of a scenario's world.

    Raises
    ------
    UserError
        when there are more classes than an image of 8 bits can hold.
    """
    world = scenario.world
    soils = world.ground_materials
    found = [*_movers(scenario), *_static(scenario)]
    kinds = [_tag(scenario, one.name) or one.kind for one in found]
    classes = _numbered({*kinds, *soils})
    objects = [
        LabeledObject(
            one.name, classes[kind], one.pose, None if kind in SURROUNDINGS else one.box_m
        )
        for one, kind in zip(found, kinds, strict=True)
    ]
    if soils:
        objects.append(LabeledObject(terrain.BODY, classes[soils[0]], ORIGIN, None))
    return ObjectLabels(
        objects=tuple(objects),
        classes=classes,
        number_of={one.name: number for number, one in enumerate(objects, 1)},
        number_of_solid={part: number for number, one in enumerate(found, 1) for part in one.parts},
        soils=tuple(classes[soil] for soil in soils),
    )


class _Found(NamedTuple):
    name: str
    kind: str
    pose: Pose
    box_m: Corners
    parts: tuple[str, ...] = ()


def _movers(scenario: Scenario) -> Iterator[_Found]:
    for vehicle in scenario.vehicles:
        box = box_around(vehicle_solids(vehicle.model))
        yield _Found(vehicle.name, vehicle.model.name, ORIGIN, box)
    for actor in scenario.world.actors:
        yield _Found(actor.name, actor.kind, ORIGIN, box_around(form_solids(actor.form)))


def _static(scenario: Scenario) -> Iterator[_Found]:
    entities = static_entities(scenario, {})
    if scenario.world.room:
        parts = entities.pop("room").parts
        yield from _of_room(scenario, parts)
    for entity in entities.values():
        kind = re.sub(r"_\d+$", "", entity.name)
        yield _Found(entity.name, kind, entity.pose, entity.box_m, entity.parts)


def _of_room(scenario: Scenario, parts: Iterable[str]) -> Iterator[_Found]:
    """Yield floor, ceiling, walls and door: `room_floor`, `wall_north_left`, `door_leaf`."""
    built = {solid.name: solid for solid in solids(scenario)}
    of_objects: dict[str, list[str]] = {}
    for part in parts:
        name = part.removeprefix("room_").partition("_")[0]
        of_objects.setdefault(name, []).append(part)
    for name, own in of_objects.items():
        first = built[own[0]]
        pose = first.position_m, first.orientation
        box = box_around(in_frame(built[part], pose) for part in own)
        yield _Found(name, name, pose, box, tuple(own))


def _tag(scenario: Scenario, name: str) -> str | None:
    described = scenario.world.entities.get(name)
    return described.tags[0] if described and described.tags else None


def _numbered(kinds: set[str]) -> dict[str, int]:
    numbers = {kind: number for number, kind in enumerate(CLASSES)}
    own = sorted(kinds - numbers.keys())
    if FIRST_OF_WORLD + len(own) > MOST_CLASSES:
        raise UserError(
            f"`labels`: too many classes: the objects of this world have {len(own)} that are not "
            f"predefined; expected up to {MOST_CLASSES - FIRST_OF_WORLD}. Fix: give objects a "
            "common tag in `world.entities`"
        )
    return numbers | {kind: number for number, kind in enumerate(own, FIRST_OF_WORLD)}
