# SPDX-License-Identifier: Apache-2.0
"""Solids, shapes and materials: plain data that hashes to the same bytes on every machine."""

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
    """A cuboid centered on the origin of its frame."""

    size_m: Size3
    """Full lengths along x, y, z."""


class Cylinder(Spec, frozen=True, tag_field="kind", tag="cylinder"):
    """A cylinder centered on the origin, its axis along z."""

    radius_m: Positive
    """Radius of the cylinder."""

    length_m: Positive
    """Full length along z."""


class Sphere(Spec, frozen=True, tag_field="kind", tag="sphere"):
    """A sphere centered on the origin."""

    radius_m: Positive
    """Radius of the sphere."""


class Mesh(Spec, frozen=True, tag_field="kind", tag="mesh"):
    """A triangle surface, open or closed, with colors of its own."""

    asset: Digest
    """Digest of the triangles, which `mesh_asset.load_mesh` reads."""

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
"""Texture patterns, which `services.sensors.rendering` draws."""

RETROREFLECTION = 1000.0
"""Return of an ideal retroreflector, in multiples of a white diffuse surface:
pi times 320 cd/(lx m^2), between types III and IV of ASTM D4956 for traffic signs."""


class Material(Spec, frozen=True):
    """Optical and contact properties of a surface."""

    reflectivity: Fraction01 = 0.5
    """Diffuse reflectance at the LiDAR's wavelength (903 nm), 0..1."""

    retroreflectivity: Fraction01 = 0.0
    """Share of an ideal retroreflector's return; 0 for a diffuse surface."""

    friction: NonNegative = 0.8
    """Coulomb friction coefficient; a contact has the product of both surfaces."""

    color: tuple[Fraction01, Fraction01, Fraction01] = (0.6, 0.6, 0.6)
    """Linear red, green and blue, 0..1 each."""

    texture: Texture = "plain"
    """Texture pattern, multiplied with the color."""

    texture_size_m: Positive = 2.0
    """Length of the pattern. Overlaid wear and a slight stretch of each object make every place
    look different."""

    @property
    def reflectance(self) -> float:
        """Returned share of light at normal incidence, 1 for a white diffuse surface."""
        return max(self.reflectivity, RETROREFLECTION * self.retroreflectivity)


class Solid(Spec, frozen=True):
    """A shape at a pose, in the frame of the world or of a vehicle's link."""

    name: str
    """Name of the solid."""

    shape: Shape
    """Shape of the solid. `kind` selects it."""

    material: str
    """Name of the solid's material."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the shape's origin in the frame."""

    orientation: Quaternion = IDENTITY_QUATERNION
    """Rotation of the shape in the frame, as a quaternion xyzw."""

    drivable: bool = False
    """Whether wheels roll on the solid at any height. Wheels always roll on solids below a
    vehicle's clearance and on ramps; all other solids collide with the chassis only."""
