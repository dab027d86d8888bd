# SPDX-License-Identifier: Apache-2.0
"""Schema of a mesh file in a world or vehicle file."""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Spec


class MeshFile(Spec, frozen=True, kw_only=True, tag_field="kind", tag="mesh"):
    """A mesh or scan in a file: OBJ, PLY, STL, glTF, GLB or PCD."""

    file: str
    """Path of the mesh, relative to the file that names it."""

    scale: Positive = 1.0
    """Meters in a unit of the file: 0.001 for millimeters."""

    up: Literal["y", "z"] | None = None
    """Up axis of the file; None: y for glTF, z for other formats. With y, the mesh is turned by 90
    degrees about x, as in Blender, so its z points south."""

    disc_m: Positive | None = None
    """Radius of the discs of a scan without faces; None: from the distance of its points."""

    most_points: Annotated[int, Meta(ge=1, le=2_000_000)] = 200_000
    """Maximum number of points; larger scans are thinned."""
