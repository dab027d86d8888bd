# SPDX-License-Identifier: Apache-2.0
"""Light sources of a world. Only cameras see light."""

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import Spec, Vector3


class Sun(Spec, frozen=True, tag_field="kind", tag="sun"):
    """Daylight under a clear sky."""

    azimuth_deg: Annotated[float, Meta(ge=0, lt=360)] = 150.0
    """Clockwise from north."""

    elevation_deg: Annotated[float, Meta(ge=5, le=90)] = 40.0


class Lamps(Spec, frozen=True, tag_field="kind", tag="lamps"):
    """Identical round lamps that shine downwards."""

    at_m: Annotated[tuple[Vector3, ...], Meta(min_length=1, max_length=4)]
    """In the world. A lamp just below a ceiling appears as a bright disc on it."""
