# SPDX-License-Identifier: Apache-2.0
"""Actors: rigid bodies that move on a script or can be pushed (people, doors, crates).

An actor's form is a set of solids in a frame whose z axis points up; its motion is a tagged union.
`actor_motion` computes scripted poses; physics computes the poses of free bodies.
"""

import re
from itertools import pairwise
from typing import Annotated, Literal

from msgspec import Meta
from msgspec.structs import replace

from groundlink.core.fields import NonNegative, Positive, Size3, Spec, Vector3

from .solids import Box, Cylinder, Solid, Sphere

MAX_PARTS = 16
"""Largest number of solids of an actor, limited by physics."""

ActorName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
Point = tuple[float, float]


Category = Literal["object", "robot", "human", "dynamic_object", "static_object"]
"""Major categories of entities, as simulation_interfaces has them."""


class EntityDescription(Spec, frozen=True, kw_only=True):
    """What tools are told about an entity."""

    category: Category | None = None
    """Category; none: vehicles are robots, persons humans, other actors dynamic objects, and
    everything else static objects."""

    description: str = ""
    """Description for people."""

    tags: tuple[str, ...] = ()
    """Tags by which tools select entities."""


class PartsForm(Spec, frozen=True, tag_field="kind", tag="parts", kw_only=True):
    """Solids given one by one; the ground is at z = 0."""

    parts: Annotated[tuple[Solid, ...], Meta(min_length=1, max_length=MAX_PARTS)]
    """Solids in the actor's frame. Physics uses the bounding boxes of meshes."""


class PersonForm(Spec, frozen=True, tag_field="kind", tag="person", kw_only=True):
    """A walking person facing +x, with the feet at z = 0."""

    height_m: Positive = 1.75
    """Height of the person."""

    shirt: str
    """Name of the material of the shirt."""

    trousers: str
    """Name of the material of the trousers and shoes."""

    skin: str
    """Name of the material of the head and hands."""


class DoorForm(Spec, frozen=True, tag_field="kind", tag="door", kw_only=True):
    """A door leaf along x with its hinge at the origin and its lower edge at z = 0."""

    width_m: Positive = 0.9
    """Width of the leaf, from the hinge."""

    height_m: Positive = 2.0
    """Height of the leaf."""

    thickness_m: Positive = 0.04
    """Thickness of the leaf."""

    material: str
    """Material of the leaf."""


class CrateForm(Spec, frozen=True, tag_field="kind", tag="crate", kw_only=True):
    """A box on z = 0, centered in x and y."""

    size_m: Size3 = (0.4, 0.4, 0.4)
    """Length along x, width along y, height."""

    material: str
    """Material of the box."""


Form = PartsForm | PersonForm | DoorForm | CrateForm


class PathMotion(Spec, frozen=True, tag_field="kind", tag="along", kw_only=True):
    """Motion from point to point, back and forth, upright with x ahead, regardless of obstacles."""

    points_m: Annotated[tuple[Point, ...], Meta(min_length=2, max_length=1000)]
    """Points of the path, x and y in the world; the actor is at the first one at time zero."""

    speed_mps: Positive = 1.2
    """Speed on the path."""

    closed: bool = False
    """Whether the path continues from the last point to the first; otherwise it reverses."""

    pause_s: NonNegative = 0.0
    """Pause at every point before the turn to the next."""

    start_s: NonNegative = 0.0
    """Sim time of the start."""

    z_m: float = 0.0
    """Height above the ground: the terrain, or z = 0."""

    def __post_init__(self) -> None:
        closing = self.points_m[:1] if self.closed else ()
        way = (*self.points_m, *closing)
        if any(here == there for here, there in pairwise(way)):
            raise ValueError("two consecutive `points_m` are equal. Fix: delete one")


class Swing(Spec, frozen=True, kw_only=True):
    """A turn about a hinge."""

    at_s: NonNegative
    """Sim time of the begin."""

    angle_deg: float
    """Final angle, counterclockwise positive; 0 is shut."""

    for_s: Positive = 1.0
    """Duration."""


class HingeMotion(Spec, frozen=True, tag_field="kind", tag="hinge", kw_only=True):
    """Motion about a vertical axis at the origin, at fixed times, regardless of obstacles."""

    at_m: Vector3
    """Position of the hinge in the world; z is above the ground."""

    yaw_deg: float = 0.0
    """Direction of x at angle 0."""

    start_deg: float = 0.0
    """Angle at time zero."""

    swings: tuple[Swing, ...] = ()
    """Turns about the hinge, in the order of their times."""

    every_s: Positive | None = None
    """Period of the swings; None: they happen once."""

    def __post_init__(self) -> None:
        free_s = 0.0
        for swing in self.swings:
            if swing.at_s < free_s:
                raise ValueError(
                    "`swings` overlap; expected each to begin after the one before has ended"
                )
            free_s = swing.at_s + swing.for_s
        if self.every_s is None:
            return
        if self.every_s < free_s:
            raise ValueError("`every_s` is shorter than all `swings` together")
        if self.swings and self.swings[-1].angle_deg != self.start_deg:
            raise ValueError("with `every_s` the last swing must end at `start_deg`")


class FreeMotion(Spec, frozen=True, tag_field="kind", tag="free", kw_only=True):
    """A free rigid body, moved by physics."""

    at_m: Vector3
    """Initial position in the world; z is above the ground."""

    yaw_deg: float = 0.0
    """Initial heading, counterclockwise from the world's x axis."""

    mass_kg: Positive
    """Mass of the body."""

    friction: NonNegative = 0.6
    """Coulomb friction coefficient; a contact has the product of both surfaces."""

    restitution: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Coefficient of restitution of contacts: 0 for no bounce."""


Motion = PathMotion | HingeMotion | FreeMotion


class Actor(Spec, frozen=True, kw_only=True):
    """A body that moves on a script or can be pushed."""

    name: ActorName
    """Name of the actor, unique in the run."""

    form: Form
    """Shape of the actor. `kind` selects it."""

    motion: Motion
    """Motion of the actor. `kind` selects it."""

    @property
    def kind(self) -> str:
        """Kind of the form; for `parts`, the actor's name without its number."""
        if isinstance(self.form, PartsForm):
            return re.sub(r"_\d+$", "", self.name)
        return str(self.form.__struct_config__.tag)


def form_solids(form: Form) -> list[Solid]:
    """Return the solids of an actor in its frame."""
    match form:
        case PartsForm(parts=solids):
            return list(solids)
        case PersonForm():
            return _figure(form)
        case DoorForm(width_m=width, height_m=height):
            leaf = Box(size_m=(width, form.thickness_m, height))
            return [Solid("leaf", leaf, form.material, (width / 2, 0.0, height / 2))]
        case CrateForm(size_m=size):
            return [Solid("crate", Box(size_m=size), form.material, (0.0, 0.0, size[2] / 2))]


_STRIDE = (0.0, 0.1305, 0.0, 0.9914)
"""Limb turned by 15 degrees about y, with its lower end behind."""

_BACK = (0.0, -0.1305, 0.0, 0.9914)


def _figure(person: PersonForm) -> list[Solid]:
    """Return a person scaled from a height of 1.75 m."""
    shirt, trousers, skin = person.shirt, person.trousers, person.skin
    leg, arm = Cylinder(radius_m=0.075, length_m=0.86), Cylinder(radius_m=0.05, length_m=0.62)
    shoe, hand = Box(size_m=(0.27, 0.1, 0.08)), Sphere(radius_m=0.055)
    figure = [
        Solid("left_shoe", shoe, trousers, (-0.19, 0.1, 0.04)),
        Solid("right_shoe", shoe, trousers, (0.25, -0.1, 0.04)),
        Solid("left_leg", leg, trousers, (-0.11, 0.1, 0.47), _STRIDE),
        Solid("right_leg", leg, trousers, (0.11, -0.1, 0.47), _BACK),
        Solid("hips", Box(size_m=(0.22, 0.34, 0.2)), trousers, (0.0, 0.0, 0.92)),
        Solid("trunk", Box(size_m=(0.2, 0.38, 0.48)), shirt, (0.0, 0.0, 1.2)),
        Solid("left_arm", arm, shirt, (0.08, 0.25, 1.13), _BACK),
        Solid("right_arm", arm, shirt, (-0.08, -0.25, 1.13), _STRIDE),
        Solid("left_hand", hand, skin, (0.17, 0.25, 0.8)),
        Solid("right_hand", hand, skin, (-0.17, -0.25, 0.8)),
        Solid("neck", Cylinder(radius_m=0.06, length_m=0.12), skin, (0.0, 0.0, 1.49)),
        Solid("head", Sphere(radius_m=0.115), skin, (0.01, 0.0, 1.635)),
    ]
    return [_scaled(part, person.height_m / 1.75) for part in figure]


def _scaled(solid: Solid, by: float) -> Solid:
    x, y, z = solid.position_m
    shape: Box | Cylinder | Sphere
    match solid.shape:
        case Box(size_m=(length, width, height)):
            shape = Box(size_m=(length * by, width * by, height * by))
        case Cylinder(radius_m=radius, length_m=length):
            shape = Cylinder(radius_m=radius * by, length_m=length * by)
        case Sphere(radius_m=radius):
            shape = Sphere(radius_m=radius * by)
        case _:
            raise AssertionError("a figure has no meshes")
    return replace(solid, shape=shape, position_m=(x * by, y * by, z * by))
