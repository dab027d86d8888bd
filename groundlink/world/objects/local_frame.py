# SPDX-License-Identifier: Apache-2.0
"""Frame of an object, in which its parts are built, and from which they are placed in the world.

Positions are rounded to a micrometer and quaternions to 1e-9: sine and cosine differ in the last
bit between processors, and the hash of a world must not.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from groundlink.core.fields import Size3, Vector3
from groundlink.core.frames import quaternion_from_rpy
from groundlink.world.solids import Box, Cylinder, Shape, Solid, Sphere


@dataclass(frozen=True)
class SupportSurface:
    """A level rectangle in the world that supports clutter, with the free height above it."""

    center_m: Vector3
    yaw_deg: float
    length_m: float
    width_m: float
    clear_m: float


@dataclass(frozen=True)
class LocalFrame:
    """Frame of an object: its name, its origin in the world and its yaw."""

    name: str
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0

    def point(self, x: float, y: float, z: float) -> Vector3:
        """Return the world position of a point of this frame."""
        c, s = cos_sin(self.yaw_deg)
        return (
            _micrometers(self.x_m + c * x - s * y),
            _micrometers(self.y_m + s * x + c * y),
            _micrometers(self.z_m + z),
        )

    def put(
        self,
        part: str,
        shape: Shape,
        at: Vector3,
        material: str,
        *,
        roll_deg: float = 0.0,
        pitch_deg: float = 0.0,
        yaw_deg: float = 0.0,
    ) -> Solid:
        """Return a part as a solid in the world, named `<frame>_<part>`."""
        turn = quaternion_from_rpy(
            *map(math.radians, (roll_deg, pitch_deg, self.yaw_deg + yaw_deg))
        )
        x, y, z, w = (round(part, 9) + 0.0 for part in turn)
        return Solid(
            name=f"{self.name}_{part}",
            shape=shape,
            material=material,
            position_m=self.point(*at),
            orientation=(x, y, z, w),
        )

    def box(self, part: str, size: Size3, at: Vector3, material: str, **turn: float) -> Solid:
        """Return a box as a part; see `put`."""
        return self.put(part, Box(size_m=size), at, material, **turn)

    def cylinder(
        self, part: str, radius: float, length: float, at: Vector3, material: str, **turn: float
    ) -> Solid:
        """Return a cylinder along z as a part; see `put`."""
        return self.put(part, Cylinder(radius_m=radius, length_m=length), at, material, **turn)

    def balls(
        self, part: str, scale: float, rows: Iterable[tuple[float, ...]], material: str
    ) -> Iterator[Solid]:
        """Yield spheres from rows of x, y, z and radius in multiples of `scale`."""
        for i, (x, y, z, radius) in enumerate(rows):
            ball = Sphere(radius_m=radius * scale)
            yield self.put(f"{part}_{i}", ball, (x * scale, y * scale, z * scale), material)

    def surface(
        self, at: Vector3, length_m: float, width_m: float, clear_m: float
    ) -> SupportSurface:
        """Return a surface around a point of this frame."""
        return SupportSurface(self.point(*at), self.yaw_deg, length_m, width_m, clear_m)


def cos_sin(angle_deg: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in degrees."""
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))


def _micrometers(value: float) -> float:
    return float(round(value, 6)) + 0.0  # + 0.0 makes -0.0 a plain zero, which hashes alike
