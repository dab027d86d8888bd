# SPDX-License-Identifier: Apache-2.0
"""Solids, shapes and materials: plain data that hashes to the same bytes on every machine."""

from typing import Annotated, Literal

from msgspec import UNSET, Meta, UnsetType

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


class Soil(Spec, frozen=True, kw_only=True):
    """Mechanical parameters of a homogeneous soil by Bekker, Wong, Janosi and Hanamoto."""

    k_c: NonNegative
    """Cohesive modulus of sinkage by Bekker, N/m^(n+1)."""

    k_phi: Positive
    """Frictional modulus of sinkage by Bekker, N/m^(n+2)."""

    n: Annotated[float, Meta(gt=0, le=2)]
    """Exponent of sinkage: the pressure under a plate of width b at depth z is
    (k_c / b + k_phi) z^n."""

    cohesion_pa: NonNegative
    """Cohesion c of the Mohr-Coulomb criterion."""

    friction_angle_deg: Annotated[float, Meta(ge=0, lt=60)]
    """Angle of internal friction phi."""

    shear_displacement_m: Positive
    """K by Janosi and Hanamoto: the displacement at which 63 % of the shear strength act."""

    density_kgpm3: Positive
    """Bulk density, for the passive pressure on the side of a wheel."""

    unloading_npm3: NonNegative = 0.0
    """k_0 by Wong: stiffness of unloading and reloading at no depth. The stiffness at depth z is
    k_0 + A_u z; zero for both: the soil does not rebound."""

    unloading_npm4: NonNegative = 0.0
    """A_u by Wong."""

    stress_angle: Annotated[float, Meta(ge=0, lt=1)] = 0.4
    """c_1 by Wong and Reece: the angle of the largest radial stress on a wheel without slip, as a
    share of the entry angle."""

    stress_angle_by_slip: Annotated[float, Meta(ge=0, lt=1)] = 0.3
    """c_2 by Wong and Reece: growth of that share with slip."""

    slip_sinkage: Annotated[float, Meta(ge=0, le=2)] = 1.0
    """Share of the slip-sinkage by Lyasko, which multiplies the sinkage of a plate by
    (1 + s) / (1 - s / 2) at a slip s; 0: sinkage by load alone."""

    def __post_init__(self) -> None:
        if self.stress_angle + self.stress_angle_by_slip >= 1.0:
            raise ValueError(
                "`stress_angle` and `stress_angle_by_slip` add up to 1 or more; expected less"
            )


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

    soil: Soil | UnsetType = UNSET
    """Soil into which wheels sink, with parameters of its own or, in a file, a name of the library
    of soils; none: the ground is rigid."""

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
