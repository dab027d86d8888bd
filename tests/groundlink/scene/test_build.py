# SPDX-License-Identifier: Apache-2.0
"""The world that is built from a scenario."""

import re
from collections.abc import Sequence
from functools import cache
from typing import Literal

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy
from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.build import STRIP_M, UnknownMaterial, WorldError, _strips, solids, world_hash
from groundlink.scene.spawn_checks import check_spawns
from groundlink.world.bounds import bounds, intersect, overlap
from groundlink.world.cover import GrassArea, WaterArea
from groundlink.world.objects.indoor_specs import Clutter, Door, Room, Shelf, Table
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere
from groundlink.world.terrain import Terrain


@pytest.fixture(scope="module")
def built(lab: Scenario) -> tuple[Solid, ...]:
    return solids(lab)


def region(x: Sequence[float], y: Sequence[float], z: Sequence[float]) -> Solid:
    """Return a box by its lowest and highest coordinates."""
    low, high = np.array([x, y, z]).T
    return Solid(
        name="region",
        shape=Box(size_m=tuple((high - low).tolist())),
        material="",
        position_m=tuple(((low + high) / 2).tolist()),
    )


def those_in(place: Solid, built: Sequence[Solid]) -> list[str]:
    around = bounds(place)
    near = [solid for solid in built if overlap(around, bounds_of(solid), touch_m=0)]
    return [solid.name for solid in near if intersect(place, solid)]


bounds_of = cache(bounds)


def is_clutter(solid: Solid) -> bool:
    return solid.name.startswith("clutter")


def test_there_is_much_in_the_laboratory(built: tuple[Solid, ...]) -> None:
    assert len(built) >= 120
    assert len({solid.name for solid in built}) == len(built)


def test_the_same_seed_gives_the_same_world(lab: Scenario) -> None:
    assert solids(lab) == solids(load("indoor_lab"))
    assert world_hash(lab) == world_hash(load("indoor_lab"))
    assert re.fullmatch("[0-9a-f]{64}", world_hash(lab))


def test_a_scenario_that_travelled_gives_the_same_hash(lab: Scenario) -> None:
    arrived = msgspec.msgpack.decode(msgspec.msgpack.encode(lab), type=Scenario)
    assert world_hash(arrived) == world_hash(lab)


@pytest.mark.parametrize("what", ["seed", "material", "mass", "name", "furniture"])
def test_hash_distinguishes_worlds(lab: Scenario, what: str) -> None:
    rover, world = lab.vehicles[0], lab.world
    heavy = replace(rover.model, chassis=replace(rover.model.chassis, mass_kg=50.0))
    wood = replace(world.materials["wood"], reflectivity=0.1)
    other = {
        "seed": replace(lab, seed=2),
        "material": replace(lab, world=replace(world, materials={**world.materials, "wood": wood})),
        "mass": replace(lab, vehicles=(replace(rover, model=heavy),)),
        "name": replace(lab, vehicles=(replace(rover, name="second"),)),
        "furniture": replace(lab, world=replace(world, furniture=world.furniture[1:])),
    }[what]
    assert world_hash(other) != world_hash(lab)


def test_the_hash_ignores_what_only_physics_reads(lab: Scenario) -> None:
    rover, world = lab.vehicles[0], lab.world
    still = replace(rover, model=replace(rover.model, vibration=None))
    for other in (
        replace(lab, vehicles=(replace(rover, effects=("vibration",)),)),
        replace(lab, vehicles=(still,)),
        replace(lab, world=replace(world, roughness="E")),
        replace(lab, vehicles=(replace(rover, model=replace(rover.model, wading=UNSET)),)),
    ):
        assert world_hash(other) == world_hash(lab)


def test_the_hash_has_cover_that_needs_terrain_and_ground_to_grow_on(lab: Scenario) -> None:
    ground = "wood"
    flat = Terrain(
        heights="0" * 64,
        cell_m=1.0,
        at_m=(0.0, 0.0, 0.0),
        low_m=(-50.0, -50.0, -1.0),
        high_m=(50.0, 50.0, 0.0),
        materials=(ground,),
    )
    yard = replace(lab, world=replace(lab.world, terrain=flat))
    pond = WaterArea(level_m=0.5, low_m=(0.0, 0.0), high_m=(9.0, 9.0), material=ground)
    meadow = GrassArea(ground=(ground,), height_m=(0.2, 0.4), material=ground)
    worlds = [
        yard.world,
        replace(yard.world, water=(pond,)),
        replace(yard.world, water=(replace(pond, level_m=0.6),)),
        replace(yard.world, grass=(meadow,)),
    ]
    assert len({world_hash(replace(yard, world=world)) for world in worlds}) == 4
    with pytest.raises(WorldError, match=r"`world.water`: expected `terrain`"):
        solids(replace(lab, world=replace(lab.world, water=(pond,))))
    elsewhere = replace(meadow, ground=("grazz",))
    with pytest.raises(WorldError, match=r"`world.grass\[0\].ground\[0\]`: no ground of `grazz`"):
        solids(replace(yard, world=replace(yard.world, grass=(elsewhere,))))
    with pytest.raises(UnknownMaterial, match=r"`world.water\[0\].material`"):
        solids(replace(yard, world=replace(yard.world, water=(replace(pond, material="ink"),))))


def test_the_hash_ignores_the_order_of_materials(lab: Scenario) -> None:
    materials = dict(reversed(lab.world.materials.items()))
    assert world_hash(replace(lab, world=replace(lab.world, materials=materials))) == (
        world_hash(lab)
    )


@pytest.mark.parametrize("seed", range(5))
def test_clutter_lies_on_something_and_overlaps_nothing(lab: Scenario, seed: int) -> None:
    built = solids(replace(lab, seed=seed))
    clutter = [solid for solid in built if is_clutter(solid)]
    assert lab.world.clutter
    assert len(clutter) == lab.world.clutter.count
    places = {"room_floor": 0, "table": 0, "shelf": 0}
    for thing in clutter:
        low, high = bounds(thing)
        center = (low + high) / 2
        # A thin slice right under the middle of it meets what carries it, all of its corners too.
        corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
        for x, y in [(center[0], center[1]), *corners]:
            under = region(
                (x - 1e-3, x + 1e-3), (y - 1e-3, y + 1e-3), (low[2] - 1e-3, low[2] - 1e-4)
            )
            carriers = those_in(under, built)
            assert len(carriers) == 1, (thing.name, carriers)
        [kind] = [kind for kind in places if carriers[0].startswith(kind)]
        places[kind] += 1
        others = [solid for solid in built if solid is not thing]
        lifted = replace(thing, position_m=(*thing.position_m[:2], thing.position_m[2] + 1e-5))
        assert those_in(lifted, others) == []
    assert min(places.values()) > 0, places


@pytest.mark.parametrize("seed", range(5))
def test_the_lane_and_the_start_are_free(lab: Scenario, seed: int) -> None:
    built = solids(replace(lab, seed=seed))
    assert those_in(region((-5.5, 5.5), (-1.5, 1.5), (0.001, 2.9)), built) == []


def test_the_floor_is_level_with_the_ground_and_the_room_is_closed(
    built: tuple[Solid, ...],
) -> None:
    named = {solid.name: bounds(solid) for solid in built}
    assert named["room_floor"][1][2] == 0.0
    assert named["room_ceiling"][0][2] == 3.0
    # Just outside each inner face there is wall, the door's opening aside.
    walls = [solid for solid in built if solid.name.startswith(("wall", "room"))]
    for x, y in ((6.05, 0.3), (-6.05, 0.3), (0.3, 4.05), (0.3, -4.05), (6.1, 4.1), (-6.1, -4.1)):
        for z in (0.1, 1.5, 2.9):
            spot = region((x - 0.01, x + 0.01), (y - 0.01, y + 0.01), (z - 0.01, z + 0.01))
            assert len(those_in(spot, walls)) == 1, (x, y, z)


@pytest.mark.parametrize(
    ("wall", "opening"),
    [
        ("north", ((0.55, 1.45), (3.5, 4.3))),
        ("south", ((0.55, 1.45), (-4.3, -3.5))),
        ("east", ((5.5, 6.3), (0.55, 1.45))),
        ("west", ((-6.3, -5.5), (0.55, 1.45))),
    ],
)
@pytest.mark.parametrize("open_deg", [0.0, 60.0, 85.0, 160.0])
def test_the_door_is_open_where_it_should_be(
    lab: Scenario,
    wall: Literal["north", "south", "east", "west"],
    opening: tuple[tuple[float, float], tuple[float, float]],
    open_deg: float,
) -> None:
    door = Door(wall=wall, at_m=1.0, width_m=1.0, open_deg=open_deg)
    room = Room(size_m=(12.0, 8.0, 3.0), door=door)
    built = solids(replace(lab, world=replace(lab.world, room=room, furniture=(), clutter=None)))
    leaf = next(solid for solid in built if solid.name == "door_leaf")
    walls = [solid for solid in built if solid.name.startswith("wall")]
    passage = region(opening[0], opening[1], (0.01, 2.04))
    assert those_in(passage, walls) == []
    assert those_in(region(opening[0], opening[1], (2.06, 2.1)), walls) == [f"wall_{wall}_lintel"]
    assert those_in(leaf, walls) == []
    x, y = (sum(span) / 2 for span in opening)
    middle = region((x - 0.2, x + 0.2), (y - 0.2, y + 0.2), (0.01, 2.04))
    assert intersect(middle, leaf) == (open_deg == 0.0)
    low, high = bounds(leaf)
    assert np.all(high < [6.06, 4.06, 2.06])
    assert np.all(low > [-6.06, -4.06, -0.01])


def test_clutter_keeps_out_of_the_doorway(lab: Scenario) -> None:
    for seed in range(5):
        built = solids(replace(lab, seed=seed))
        passage = region((4.15, 5.05), (-4.3, -3.2), (0.01, 2.0))
        assert those_in(passage, built) in ([], ["door_leaf"])


def test_furniture_stands_on_the_floor_and_has_its_size(lab: Scenario) -> None:
    world = replace(
        lab.world,
        furniture=(Table(at_m=(1.0, 2.0), yaw_deg=90.0), Shelf(at_m=(-3.0, 0.0), boards=4)),
        clutter=None,
    )
    built = solids(replace(lab, world=world, vehicles=()))
    for prefix, size in (("table_0", (0.8, 1.6, 0.74)), ("shelf_1", (1.0, 0.35, 1.9))):
        corners = [bounds(solid) for solid in built if solid.name.startswith(prefix)]
        low = np.min([low for low, _ in corners], axis=0)
        high = np.max([high for _, high in corners], axis=0)
        assert low[2] == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose(high - low, size, atol=1e-6)


@pytest.mark.parametrize(
    ("place", "path"),
    [
        ("wall", ("world", "room", "wall_material")),
        ("table", ("world", "furniture", 0, "material")),
        ("clutter", ("world", "clutter", "materials", 1)),
        ("solid", ("world", "solids", 0, "material")),
        ("visual", ("vehicles", 0, "model", "visuals", 0, "material")),
    ],
)
def test_an_unknown_material_is_named_with_the_nearest(
    lab: Scenario, place: str, path: tuple[str | int, ...]
) -> None:
    world, rover = lab.world, lab.vehicles[0]
    thing = Solid(name="x", shape=Sphere(radius_m=0.1), material="woood")
    model = replace(rover.model, visuals=(thing,))
    assert world.room
    changed = {
        "wall": replace(lab, world=replace(world, room=replace(world.room, wall_material="woood"))),
        "table": replace(
            lab, world=replace(world, furniture=(Table(at_m=(0.0, 3.0), material="woood"),))
        ),
        "clutter": replace(
            lab, world=replace(world, clutter=Clutter(count=1, materials=("wood", "woood")))
        ),
        "solid": replace(lab, world=replace(world, solids=(thing,))),
        "visual": replace(lab, vehicles=(replace(rover, model=model),)),
    }[place]
    with pytest.raises(UnknownMaterial, match=r"`woood`.*did you mean `wood`") as caught:
        solids(changed)
    assert caught.value.path == path
    assert "\n" not in str(caught.value)


def test_too_much_clutter_is_refused(lab: Scenario) -> None:
    world = replace(lab.world, clutter=Clutter(count=2000, size_m=(0.3, 0.6)))
    with pytest.raises(WorldError, match=r"world.clutter.count.*of 2000"):
        solids(replace(lab, world=world))


def test_two_solids_of_one_name_are_refused(lab: Scenario) -> None:
    thing = Solid(name="x", shape=Sphere(radius_m=0.1), material="wood", position_m=(0, 0, 1))
    with pytest.raises(WorldError, match="two bodies are named `x`"):
        solids(replace(lab, world=replace(lab.world, solids=(thing, thing))))


@pytest.mark.parametrize(
    ("placement", "what"),
    [
        (Placement(x_m=-5.6), "wall_west_whole"),
        (Placement(x_m=-3.3, y_m=-2.0), "table_21_leg"),
        # Under a table of 0.74 m there is room for the chassis, but not for the mast.
        (Placement(x_m=2.3, y_m=-2.55, yaw_deg=90.0), "table_23_top"),
        (Placement(x_m=0.2, y_m=2.0, yaw_deg=60.0), "pillar_10_column"),
        (Placement(z_m=-0.2), "room_floor"),
    ],
)
def test_a_start_inside_something_is_refused(
    lab: Scenario, placement: Placement, what: str
) -> None:
    rover = replace(lab.vehicles[0], placement=placement)
    with pytest.raises(WorldError, match=rf"vehicles\[0\].placement.*`rover`.*`{what}"):
        started(replace(lab, vehicles=(rover,)))


def started(scenario: Scenario) -> None:
    check_spawns(scenario, solids(scenario))


def test_two_vehicles_on_one_spot_are_refused(lab: Scenario) -> None:
    rover = lab.vehicles[0]
    beside = replace(rover, name="second", placement=Placement(x_m=-4.6, y_m=0.7))
    started(replace(lab, vehicles=(rover, beside)))
    within = replace(rover, name="second", placement=Placement(x_m=-4.2, y_m=0.3, yaw_deg=45.0))
    with pytest.raises(WorldError, match="`second` starts inside `rover`"):
        started(replace(lab, vehicles=(rover, within)))


def box(
    size: tuple[float, float, float],
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Solid:
    return Solid(
        name="box",
        shape=Box(size_m=size),
        material="",
        position_m=at,
        orientation=quaternion_from_rpy(*np.radians(rpy_deg)),
    )


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (box((1, 1, 1), (0.99, 0, 0)), True),
        (box((1, 1, 1), (1.01, 0, 0)), False),
        # A corner turned towards the face, and one whose box along the axes would overlap.
        (box((1, 1, 1), (1.2, 0, 0), (0, 0, 45)), True),
        (box((1, 1, 1), (1.21, 0, 0), (0, 0, 45)), False),
        (box((1, 1, 1), (0.84, 0.84, 0), (0, 0, 45)), True),
        (box((1, 1, 1), (0.87, 0.87, 0), (0, 0, 45)), False),
        # Two edges that cross: only the axis across both tells them apart.
        (box((2, 0.2, 0.2), (0.5, 0.9, 0.8), (-30, 40, -70)), False),
        (box((2, 0.2, 0.2), (0.3, 0.6, 0.5), (-30, 40, -70)), True),
    ],
)
def test_boxes_intersect(other: Solid, expected: bool) -> None:
    unit = box((1, 1, 1))
    assert intersect(unit, other) == expected
    assert intersect(other, unit) == expected


@pytest.mark.parametrize(
    ("shape", "half"),
    [
        (Box(size_m=(2.0, 4.0, 6.0)), (1.0, 3.0, 2.0)),
        (Cylinder(radius_m=1.0, length_m=6.0), (1.0, 3.0, 1.0)),
        (Sphere(radius_m=1.5), (1.5, 1.5, 1.5)),
    ],
)
def test_bounds_of_turned_shapes(shape: Shape, half: tuple[float, float, float]) -> None:
    solid = Solid(
        name="x",
        shape=shape,
        material="",
        position_m=(1.0, 2.0, 3.0),
        orientation=quaternion_from_rpy(np.pi / 2, 0, 0),
    )
    low, high = bounds(solid)
    np.testing.assert_allclose(low, np.array((1, 2, 3)) - half, atol=1e-9)
    np.testing.assert_allclose(high, np.array((1, 2, 3)) + half, atol=1e-9)


def test_a_world_may_be_empty_but_for_its_solids(lab: Scenario) -> None:
    ground = Solid(
        name="ground", shape=Box(size_m=(9, 9, 1)), material="m", position_m=(0, 0, -0.5)
    )
    world = replace(
        lab.world,
        room=None,
        furniture=(),
        clutter=None,
        solids=(ground,),
        materials={"m": Material()},
    )
    assert solids(replace(lab, world=world, vehicles=())) == (ground,)


def test_the_strips_along_the_walls_are_inside_the_room_and_go_all_around() -> None:
    length, width = 6.0, 4.3
    strips = _strips(Room(size_m=(length, width, 2.5)))
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
    for strip in strips:
        turn = np.radians(strip.yaw_deg)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        at = corners * (strip.length_m, strip.width_m) @ rotation.T + strip.center_m[:2]
        assert (np.abs(at) <= np.array([length, width]) / 2 + 1e-9).all()
    area = sum(strip.length_m * strip.width_m for strip in strips)
    inner = (length - 2 * STRIP_M) * (width - 2 * STRIP_M)
    assert area == pytest.approx(length * width - inner)


def test_a_room_may_have_no_door(lab: Scenario) -> None:
    assert lab.world.room is not None
    closed = replace(lab.world, room=replace(lab.world.room, door=None))
    assert solids(replace(lab, world=closed))
