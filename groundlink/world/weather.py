# SPDX-License-Identifier: Apache-2.0
"""Weather and light of a world: fog, rain, dust, heat; sun or lamps.

Cameras see light; LiDARs are disturbed by the sun if their data sheets say so.
"""

import math
from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Size3, Spec, Vector3


class Dust(Spec, frozen=True, kw_only=True):
    """A box of dust or smoke that stands still, its sides along the world's axes."""

    center_m: Vector3
    """Center of the box in the world."""

    size_m: Size3
    """Full lengths of the box along x, y, z."""

    visibility_m: Positive
    """Meteorological optical range within the box, as `fog_visibility_m` of the weather."""


class Weather(Spec, frozen=True, kw_only=True):
    """Weather of the whole world, with local boxes of dust."""

    fog_visibility_m: Positive | None = None
    """Meteorological optical range: distance at which 5 % of a beam's light are left. None: clear
    air."""

    rain_mm_per_h: NonNegative = 0.0
    """Rate of the rain: 2 is light rain, 25 a downpour."""

    dust: tuple[Dust, ...] = ()
    """Local boxes of dust or smoke."""

    temperature_c: float | None = None
    """Temperature of the air, at which IMUs drift as their data sheets say. None: they stay at the
    temperature of their calibration."""

    @property
    def is_clear(self) -> bool:
        """Whether beams meet neither fog nor rain nor dust."""
        return self.fog_visibility_m is None and not self.rain_mm_per_h and not self.dust


class Sun(Spec, frozen=True, tag_field="kind", tag="sun"):
    """Daylight under a clear sky."""

    azimuth_deg: Annotated[float, Meta(ge=0, lt=360)] = 150.0
    """Direction of the sun, clockwise from north."""

    elevation_deg: Annotated[float, Meta(ge=5, le=90)] = 40.0
    """Angle of the sun above the horizon."""

    @property
    def towards(self) -> Vector3:
        """Unit vector towards the sun: x east, y north, z up."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        level = math.cos(elevation)
        return level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)


class Lamps(Spec, frozen=True, tag_field="kind", tag="lamps"):
    """Identical round lamps that shine downwards."""

    at_m: Annotated[tuple[Vector3, ...], Meta(min_length=1, max_length=4)]
    """Positions in the world. A lamp just below a ceiling appears as a bright disc on it."""
