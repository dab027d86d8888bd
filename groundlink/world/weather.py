# SPDX-License-Identifier: Apache-2.0
"""Weather of a world: fog, rain and dust."""

from __future__ import annotations

from groundlink.core.fields import NonNegative, Positive, Size3, Spec, Vector3


class Dust(Spec, frozen=True, kw_only=True):
    """A box of dust or smoke that stands still, its sides along the world's axes."""

    center_m: Vector3
    size_m: Size3
    visibility_m: Positive
    """Within it; see `Weather.fog_visibility_m`."""


class Weather(Spec, frozen=True, kw_only=True):
    """What is in the air of a world, everywhere unless it is dust."""

    fog_visibility_m: Positive | None = None
    """Meteorological optical range: where 5 % of the light of a beam are left. None: clear air;
    1000 m and less is called fog."""

    rain_mm_per_h: NonNegative = 0.0
    """2 is light rain, 25 a downpour."""

    dust: tuple[Dust, ...] = ()
