# SPDX-License-Identifier: Apache-2.0
"""Schema of an occupancy map in a world file, and of the YAML file of nav2's map_server."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from groundlink.core.fields import Fraction01, Positive, Spec, Vector3


class OccupancyMapFile(Spec, frozen=True, kw_only=True):
    """A map of nav2's map_server: walls where it is occupied, a floor where it is known."""

    file: str
    """Path of the map's YAML file, relative to the file that names it."""

    wall_height_m: Positive = 2.5
    """Height of the walls."""

    wall_material: str = "plaster"
    """Material of the walls."""

    floor_material: str = "linoleum"
    """Material of the floor."""


class MapServerYaml(Struct, frozen=True, kw_only=True):
    """YAML file of map_server. Keys that map_server does not read are ignored."""

    image: Annotated[str, Meta(min_length=1)]
    """Path of the picture, relative to this file. Its first row is the northern one."""

    resolution: Positive
    """Edge length of a cell in meters."""

    origin: Vector3
    """Lower left corner of the picture in the world: x and y in meters, yaw in radians."""

    negate: bool | Annotated[int, Meta(ge=0, le=1)]
    """Whether white is occupied, in place of black."""

    occupied_thresh: Fraction01
    """Darkness from which a cell is occupied."""

    free_thresh: Fraction01
    """Darkness up to which a cell is free."""

    mode: Literal["trinary", "scale", "raw"] = "trinary"
    """How pixels become values of cells."""

    def __post_init__(self) -> None:
        if not self.free_thresh < self.occupied_thresh:
            raise ValueError(
                f"`free_thresh` is {self.free_thresh:g}; expected less than `occupied_thresh`, "
                f"{self.occupied_thresh:g}"
            )
