# SPDX-License-Identifier: Apache-2.0
"""Weather of a world: fog, rain and dust."""

from groundlink.core.fields import NonNegative, Positive, Size3, Spec, Vector3


class Dust(Spec, frozen=True, kw_only=True):
    """A box of dust or smoke that stands still, its sides along the world's axes."""

    center_m: Vector3
    size_m: Size3
    visibility_m: Positive
    """Within it; see `Weather.fog_visibility_m`."""


class Weather(Spec, frozen=True, kw_only=True):
    """Weather of the whole world, with local boxes of dust."""

    fog_visibility_m: Positive | None = None
    """Meteorological optical range: distance at which 5 % of a beam's light are left. None: clear
    air."""

    rain_mm_per_h: NonNegative = 0.0
    """2 is light rain, 25 a downpour."""

    dust: tuple[Dust, ...] = ()
