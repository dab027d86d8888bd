# SPDX-License-Identifier: Apache-2.0
"""The vocabulary of things: a solid is a shape of a material at a pose.

Rule: plain data that a scenario file can hold and that hashes to the same bytes everywhere. What a
solid does (collide, reflect, look like something) is the business of those who read it.
"""

from __future__ import annotations

from typing import Literal

from groundlink.core.fields import (
    Fraction01,
    NonNegative,
    Positive,
    Quaternion,
    Size3,
    Spec,
    Vector3,
)
from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.world.assets import Digest


class Box(Spec, frozen=True, tag_field="kind", tag="box"):
    """A cuboid centred on the origin of its frame."""

    size_m: Size3
    """Full lengths along x, y, z."""


class Cylinder(Spec, frozen=True, tag_field="kind", tag="cylinder"):
    """A cylinder centred on the origin, its axis along z."""

    radius_m: Positive
    length_m: Positive


class Sphere(Spec, frozen=True, tag_field="kind", tag="sphere"):
    """A ball centred on the origin."""

    radius_m: Positive


class Mesh(Spec, frozen=True, tag_field="kind", tag="mesh"):
    """A surface of triangles with colours of its own, open or closed, around wherever it likes."""

    asset: Digest
    """What `mesh_asset.load_mesh` reads."""

    low_m: Vector3
    """Lowest corner of the box around it along its own axes."""

    high_m: Vector3
    """Highest corner of that box."""


Shape = Box | Cylinder | Sphere | Mesh


Texture = Literal[
    "plain",
    "stained",
    "speckled",
    "wood",
    "brushed",
    "tiles",
    "bricks",
    "printed",
    "grass",
    "soil",
    "gravel",
    "rock",
    "water",
    "leaves",
    "bark",
    "roof_tiles",
    "snow",
]
"""How cameras see a surface: what each pattern looks like is `services.sensors.rendering`'s."""

RETROREFLECTION = 1000.0
"""Light that an ideal retroreflector sends back, in multiples of what a white diffuse surface does:
pi times 320 cd/(lx m^2), between types III and IV of ASTM D4956 for traffic signs."""


class Material(Spec, frozen=True):
    """What a surface is like to those who touch it or look at it."""

    reflectivity: Fraction01 = 0.5
    """Diffuse reflectance at the LiDAR's wavelength (903 nm), 0..1."""

    retroreflectivity: Fraction01 = 0.0
    """Share of what an ideal retroreflector sends back to where the light came from; 0 for a
    diffuse surface."""

    friction: NonNegative = 0.8
    """Coulomb coefficient of the surface; a contact has the product of both surfaces'."""

    color: tuple[Fraction01, Fraction01, Fraction01] = (0.6, 0.6, 0.6)
    """Linear red, green, blue."""

    texture: Texture = "plain"
    """The pattern that cameras see in the colour."""

    texture_size_m: Positive = 2.0
    """Length of the pattern. It comes again and again with other wear on it, each thing has it
    stretched by some hundredths of its own, and no two places look quite alike."""

    @property
    def reflectance(self) -> float:
        """What comes back of light that falls in squarely, 1 for a white diffuse surface."""
        return max(self.reflectivity, RETROREFLECTION * self.retroreflectivity)


class Solid(Spec, frozen=True):
    """A shape in place. In a world the frame is the world; in a vehicle it is the link's."""

    name: str
    shape: Shape
    material: str
    position_m: Vector3 = (0.0, 0.0, 0.0)
    orientation: Quaternion = IDENTITY_QUATERNION
    """Quaternion xyzw."""

    drivable: bool = False
    """Whether wheels roll on it however high it is. On what is as low as a vehicle's clearance, and
    on boxes that lean as ramps do, they roll anyway; all else is met by chassis alone."""
