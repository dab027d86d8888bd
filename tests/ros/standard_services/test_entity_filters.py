# SPDX-License-Identifier: Apache-2.0
"""Which entities filters accept."""

import pytest

from udp_bridge_ros2.standard_services.entity_filters import EntitySelection, TagSelection
from udp_bridge_ros2.standard_services.overlap import ConvexRegion
from udp_bridge_ros2.standard_services.posix_regex import compile_posix
from udp_bridge_ros2.standard_services.world_queries import Entity

ZERO = (0.0, 0.0, 0.0)


def entity(name: str, category: str, x: float, *tags: str, size_m: float = 1.0) -> Entity:
    half = size_m / 2
    corners = ((-half, -half, -half), (half, half, half)) if size_m else (None, None)
    upright = (0.0, 0.0, 0.0, 1.0)
    place = ((x, 0.0, 0.0), upright, ZERO, ZERO, ZERO, ZERO)
    return Entity(name, category, "", tags, False, *place, *corners)


ENTITIES = [
    entity("rover", "robot", 0.0, "tracked", "red"),
    entity("rover_2", "robot", 5.0, "red"),
    entity("crate", "dynamic_object", 1.0),
    entity("mark", "object", 3.0, "tracked", size_m=0.0),
]


@pytest.mark.parametrize(
    ("selection", "names"),
    [
        (EntitySelection(), ["rover", "rover_2", "crate", "mark"]),
        (EntitySelection(name=compile_posix("rover")), ["rover"]),
        (EntitySelection(name=compile_posix("rover.*")), ["rover", "rover_2"]),
        (EntitySelection(categories=frozenset({"object", "robot"})), ["rover", "rover_2", "mark"]),
        (EntitySelection(categories=frozenset({"human"})), []),
        (
            EntitySelection(tags=TagSelection(frozenset({"tracked", "red"}))),
            ["rover", "rover_2", "mark"],
        ),
        (EntitySelection(tags=TagSelection(frozenset({"tracked", "red"}), True)), ["rover"]),
        (EntitySelection(tags=TagSelection(frozenset(), True)), [row.name for row in ENTITIES]),
        (EntitySelection(region=ConvexRegion((ZERO,), 0.6)), ["rover", "crate"]),
        (EntitySelection(region=ConvexRegion(((3.0, 0.0, 0.0),), 0.1)), ["mark"]),
        (
            EntitySelection(
                compile_posix("r.*"),
                frozenset({"robot"}),
                TagSelection(frozenset({"red"})),
                ConvexRegion(((5.0, 0.0, 0.0),), 1.0),
            ),
            ["rover_2"],
        ),
    ],
)
def test_all_filters_must_accept(selection: EntitySelection, names: list[str]) -> None:
    assert [row.name for row in ENTITIES if selection.accepts(row)] == names
