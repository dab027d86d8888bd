# SPDX-License-Identifier: Apache-2.0
"""Schema of a mesh file in a world or vehicle file."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Spec


class MeshFile(Spec, frozen=True, kw_only=True, tag_field="kind", tag="mesh"):
    """A mesh or scan in a file: OBJ, PLY, STL, glTF or GLB; PCD and PLY also without faces."""

    file: str
    scale: Positive = 1.0
    """Metres in a unit of the file: 0.001 for millimeters."""

    up: Literal["y", "z"] | None = None
    """The file's axis that points up; None: y for glTF, z for all others. With y, the file's z
    points south: it is turned by 90 degrees about x, as Blender does."""

    disc_m: Positive | None = None
    """Radius of the discs that stand for the points of a scan without faces; None: by how far they
    are apart."""

    most_points: Annotated[int, Meta(ge=1, le=2_000_000)] = 200_000
    """A scan with more is thinned."""
