# SPDX-License-Identifier: Apache-2.0
"""Houses, fences and plants as solids, on the ground that they are told."""

import numpy as np
import pytest

from groundlink.core.frames import matrix_from_quaternion
from groundlink.world.bounds import bounds, half_extents
from groundlink.world.objects.outdoor_objects import (
    BUILDERS,
    BURIED_M,
    EAVES_M,
    FOOTING_M,
    build_outdoor_object,
)
from groundlink.world.objects.outdoor_specs import Fence, House, OutdoorObject, Tree
from groundlink.world.solids import Box, Cylinder, Solid

AT = (12.0, -7.0)
GROUND_M = 3.25

THINGS: list[OutdoorObject] = [
    *(kind(at_m=AT, yaw_deg=30.0, z_m=GROUND_M) for kind in BUILDERS),
    *(
        Tree(at_m=AT, z_m=GROUND_M, species=species, height_m=10.0)
        for species in ("birch", "spruce")
    ),
    House(at_m=AT, z_m=GROUND_M, size_m=(16.0, 10.0, 4.5), windows=False, door_m=(4.0, 3.8)),
]


def corners(solid: Solid) -> np.ndarray:
    """Return the corners of the box around a solid in its own axes, in the world."""
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    turn = matrix_from_quaternion(solid.orientation)
    return np.array(solid.position_m) + (signs * half_extents(solid.shape)) @ turn.T


def named(solids: list[Solid]) -> dict[str, Solid]:
    return {solid.name.split("_", 2)[2]: solid for solid in solids}


@pytest.mark.parametrize("thing", THINGS, ids=lambda thing: type(thing).__name__)
def test_a_thing_stands_at_its_place_and_on_its_ground(thing: OutdoorObject) -> None:
    built = build_outdoor_object(4, thing)
    assert len({solid.name for solid in built}) == len(built)
    kind = thing.__struct_config__.tag
    assert all(solid.name.startswith(f"{kind}_4_") for solid in built)
    lows, highs = (np.array([bounds(solid)[i] for solid in built]) for i in (0, 1))
    lowest = lows[:, 2].min()
    assert GROUND_M - max(BURIED_M, FOOTING_M) - 0.25 <= lowest <= GROUND_M + 1e-6
    assert highs[:, 2].max() > GROUND_M + 0.3
    assert np.all(lows.min(axis=0)[:2] <= AT)
    assert np.all(highs.max(axis=0)[:2] >= AT)


@pytest.mark.parametrize("thing", THINGS, ids=lambda thing: type(thing).__name__)
def test_no_part_hangs_in_the_air(thing: OutdoorObject) -> None:
    built = build_outdoor_object(0, thing)
    boxes = [bounds(solid) for solid in built]
    held = {i for i, (low, _) in enumerate(boxes) if low[2] <= GROUND_M + 1e-6}
    for _ in built:
        held |= {
            i
            for i, (low, high) in enumerate(boxes)
            if any(np.all(low <= boxes[j][1]) and np.all(high >= boxes[j][0]) for j in held)
        }
    assert held == set(range(len(built)))


@pytest.mark.parametrize("roof_deg", [20.0, 38.0, 44.0])
def test_a_roof_meets_at_the_ridge_and_covers_the_gables(roof_deg: float) -> None:
    house = House(at_m=(0.0, 0.0), z_m=0.0, roof_deg=roof_deg, chimney=False)
    parts = named(build_outdoor_object(0, house))
    length, width, eaves = house.size_m
    ridge = eaves + width / 2 * np.tan(np.radians(roof_deg))
    for side, name in ((-1, "front"), (1, "back")):
        roof = corners(parts[f"roof_{name}"])
        slope = np.tan(np.radians(roof_deg))
        # Its lower face leads from the eaves to the ridge, and on by EAVES_M.
        on_it = np.abs(roof[:, 2] - (ridge - side * roof[:, 1] * slope)) < 1e-6
        assert on_it.sum() == 4
        assert max(side * roof[on_it][:, 1]) == pytest.approx(width / 2 + EAVES_M, abs=1e-6)
        upper = roof[~on_it]
        assert min(side * upper[:, 1]) == pytest.approx(0.0, abs=1e-6)
        attic = corners(parts[f"attic_{name}"])
        assert np.all(attic[:, 2] <= ridge - np.abs(attic[:, 1]) * slope + 1e-6)
        assert np.all(np.abs(attic[:, 1]) <= width / 2 + 1e-6)
        # From the eaves' corner to below the ridge there is a gable.
        along = attic[np.abs(attic[:, 2] - (ridge - side * attic[:, 1] * slope)) < 1e-6]
        assert sorted(np.round(side * along[:, 1], 6)) == [0, 0, width / 2, width / 2]
        assert np.ptp(attic[:, 0]) > length - 0.1


@pytest.mark.parametrize("length_m", [9.0, 12.0])
def test_windows_keep_off_the_door_and_within_the_walls(length_m: float) -> None:
    house = House(at_m=(0.0, 0.0), z_m=0.0, size_m=(length_m, 8.0, 6.0))
    parts = named(build_outdoor_object(0, house))
    low, high = bounds(parts["door_frame"])
    windows = [solid for name, solid in parts.items() if name.startswith("window")]
    assert len(windows) > 30
    for solid in windows:
        near, far = bounds(solid)
        assert far[2] < house.size_m[2]
        in_front = near[1] < -3.9
        assert not (in_front and near[2] < high[2] and near[0] < high[0] and far[0] > low[0])


def test_a_fence_follows_the_ground() -> None:
    fence = Fence(points_m=((0.0, 0.0), (6.0, 0.0), (6.0, 4.0)), spacing_m=3.0)
    feet = fence.feet()
    assert feet == [(0.0, 0.0), (3.0, 0.0), (6.0, 0.0), (6.0, 2.0), (6.0, 4.0)]
    heights = (1.0, 1.5, 2.5, 2.5, 1.0)
    told = Fence(points_m=fence.points_m, ground_m=heights)
    parts = named(build_outdoor_object(0, told))
    posts = [solid for name, solid in parts.items() if name.startswith("post")]
    for post, (x, y), z in zip(posts, feet, heights, strict=True):
        low, high = bounds(post)
        assert post.position_m[:2] == (x, y)
        assert high[2] == pytest.approx(z + fence.height_m)
        assert low[2] == pytest.approx(z - BURIED_M)
    for bay in range(4):
        rail = parts[f"rail_{bay}_1"]
        assert isinstance(rail.shape, Cylinder)
        axis = matrix_from_quaternion(rail.orientation)[:, 2] * rail.shape.length_m / 2
        ends = np.array([np.array(rail.position_m) - axis, np.array(rail.position_m) + axis])
        above = fence.height_m - 0.12
        expected = [(*feet[bay + i], heights[bay + i] + above) for i in (0, 1)]
        np.testing.assert_allclose(ends[np.argsort(ends @ (1, 1, 0))], expected, atol=1e-5)


def test_a_spruce_is_pointed() -> None:
    tree = Tree(at_m=(0.0, 0.0), z_m=0.0, species="spruce", height_m=10.0)
    parts = named(build_outdoor_object(0, tree))
    cubes = [parts[f"crown_{i}"] for i in range(7)]
    assert all(isinstance(cube.shape, Box) for cube in cubes)
    tops = [corners(cube)[:, 2].max() for cube in cubes]
    assert tops == sorted(tops)
    assert tops[-1] == pytest.approx(10.0, abs=0.4)
    for cube in cubes:
        place = corners(cube)
        highest = place[place[:, 2].argmax()]
        np.testing.assert_allclose(highest[:2], cube.position_m[:2], atol=1e-5)
