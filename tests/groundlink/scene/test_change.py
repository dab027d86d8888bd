# SPDX-License-Identifier: Apache-2.0
"""Things come into a scenario and go; all else stays as it is."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader.additions import KINDS, SpawnPlace, _placed, addition
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario
from groundlink.scenario.additions import Addition
from groundlink.scenario.schema import Placement
from groundlink.scene.bodies import link_bodies
from groundlink.scene.build import solids, world_hash
from groundlink.scene.change import with_more, without
from groundlink.scene.spawn_checks import vehicle_bodies
from groundlink.world.actors import FreeMotion, PathMotion
from groundlink.world.solids import Box, Solid
from groundlink.world.terrain import Ground

FREE = SpawnPlace(0.0, 0.0)


def made(
    given: str, at: SpawnPlace = FREE, name: str | None = None, taken: tuple[str, ...] = ()
) -> Addition:
    return addition(given, at=at, name=name, taken=taken, ground=None)[1]


def grown(scenario: Scenario, more: Addition) -> Scenario:
    return with_more(scenario, more, (), seconds=0.0)


def test_unknown_word_lists_all_valid_ones() -> None:
    with pytest.raises(UserError, match="no world, vehicle or scenario `nosuch`") as caught:
        made("nosuch")
    for word in (*KINDS, "rover", "lab"):
        assert re.search(rf"\b{word}\b", str(caught.value))
    with pytest.raises(UserError, match="did you mean `person`"):
        made("persom")


@pytest.mark.parametrize("kind", KINDS)
def test_additions_come_last(lab: Scenario, kind: str) -> None:
    more = made(kind)
    changed = grown(lab, more)
    before, after = solids(lab), solids(changed)
    # Clutter stays where it was placed, in the same order.
    assert after[: len(before)] == before
    assert [s.name for s in after[len(before) :]] == [s.name for s in more.solids]
    assert link_bodies(changed) == [*link_bodies(lab), *(a.name for a in more.actors)]
    assert world_hash(changed) != world_hash(lab)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(changed), type=Scenario) == changed


@pytest.mark.parametrize("kind", KINDS)
def test_additions_can_be_removed(lab: Scenario, kind: str) -> None:
    more = made(kind)
    again = without(grown(lab, more), kind)
    assert solids(again) == solids(lab)
    assert link_bodies(again) == link_bodies(lab)


@pytest.mark.parametrize("kind", ["box", "crate", "rover"])
def test_an_exact_name_removes_no_other_that_begins_with_it(lab: Scenario, kind: str) -> None:
    first = made(kind, SpawnPlace(1.0, 0.0), name="thing", taken=("rover/base_link",))
    second = made("box", SpawnPlace(0.0, -2.0), name="thing_2")
    left = without(grown(grown(lab, first), second), "thing")
    assert solids(left) == solids(grown(lab, second))
    assert link_bodies(left) == link_bodies(lab)


def test_clutter_can_be_taken_out_piece_by_piece(lab: Scenario) -> None:
    before = solids(lab)
    after = solids(without(lab, "clutter_3"))
    assert [s for s in before if s.name != "clutter_3"] == list(after)
    assert len(after) == len(before) - 1


def test_a_vehicle_comes_with_a_namespace_of_its_own(lab: Scenario) -> None:
    more = made("rover", SpawnPlace(1.0, 0.0, 0.0, 90.0), taken=("rover/base_link",))
    (vehicle,) = more.vehicles
    assert (vehicle.name, vehicle.namespace) == ("rover_2", "/rover_2")
    assert (vehicle.frame_prefix, vehicle.command_topic) == ("rover_2/", "/rover_2/cmd_vel")
    assert vehicle.placement == Placement(1.0, 0.0, 0.0, 90.0)
    changed = grown(lab, more)
    assert [v.name for v in changed.vehicles] == ["rover", "rover_2"]
    assert [v.name for v in without(changed, "rover").vehicles] == ["rover_2"]


@pytest.mark.parametrize(
    ("taken", "name"),
    [((), "box"), (("box",), "box_2"), (("box_lid", "box_2"), "box_3"), (("boxes",), "box")],
)
def test_names_are_numbered_where_they_are_taken(taken: tuple[str, ...], name: str) -> None:
    assert made("box", taken=taken).names() == [name]


def test_things_are_put_on_the_ground_at_their_place() -> None:
    heights = np.full((3, 3), 2.0, np.float32)
    ground = Ground(heights, np.zeros((2, 2), np.uint8), 5.0, -5.0, -5.0, ("soil",))
    at = SpawnPlace(1.0, 2.0, 0.5, 90.0)
    _, boxes = addition("box", at=at, name="it", taken=(), ground=ground)
    (box,) = boxes.solids
    assert box.name == "it"
    assert box.position_m == pytest.approx((1.0, 2.0, 2.75))
    assert box.orientation == pytest.approx((0, 0, np.sqrt(0.5), np.sqrt(0.5)))
    _, crates = addition("crate", at=at, name=None, taken=(), ground=ground)
    motion = crates.actors[0].motion
    assert isinstance(motion, FreeMotion)
    # Of actors and vehicles, z counts from the ground anyway.
    assert (motion.at_m, motion.yaw_deg) == (pytest.approx((1.0, 2.0, 0.5)), 90.0)
    turned = replace(crates.actors[0], motion=replace(motion, yaw_deg=30.0))
    placed = _placed(replace(crates, actors=(turned,)), at, ground).actors[0].motion
    assert isinstance(placed, FreeMotion)
    assert placed.yaw_deg == 120.0
    with pytest.raises(UserError, match="--at 9,0 is outside the terrain"):
        addition("box", at=SpawnPlace(9.0, 0.0), name=None, taken=(), ground=ground)


WORLD = """
name: yard_things
materials: {plank: {color: [0.3, 0.2, 0.1]}}
solids:
  - name: post
    shape: {kind: box, size_m: [0.1, 0.1, 1.0]}
    material: plank
    position_m: [1.0, 0.0, 0.5]
actors:
  - name: guard
    form: {kind: crate, material: plank}
    motion: {kind: along, points_m: [[0, 1], [0, 3]]}
"""


def test_file_adds_solids_and_actors(lab: Scenario, tmp_path: Path) -> None:
    file = tmp_path / "things.yaml"
    file.write_text(WORLD)
    more = made(str(file), SpawnPlace(-3.0, 0.0, 0.0, 90.0))
    assert more.names() == ["yard_things_guard", "yard_things_post"]
    assert more.solids[0].position_m == pytest.approx((-3.0, 1.0, 0.5))
    motion = more.actors[0].motion
    assert isinstance(motion, PathMotion)
    np.testing.assert_allclose(motion.points_m, [[-4.0, 0.0], [-6.0, 0.0]], atol=1e-12)
    file.write_text(
        WORLD + "room: {size_m: [3, 3, 3], wall_material: plank, floor_material: plank}"
    )
    with pytest.raises(UserError, match="only `solids`, `actors` and `materials`"):
        made(str(file))
    file.write_text("name: nothing\nmaterials: {}\n")
    with pytest.raises(UserError, match="nothing to add"):
        made(str(file))
    with pytest.raises(UserError, match="a scenario; expected a vehicle"):
        made(str(SHIPPED / "indoor_lab.yaml"))


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (made("box", name="rover"), "the name `rover` is taken"),
        (made("box", name="clutter_3"), "the name `clutter_3` is taken"),
        (made("rover", name="clock"), "`clock` is reserved for a key of the bus"),
        (made("crate", SpawnPlace(-4.6, 0.0)), "`crate` would be inside `rover`"),
        (made("crate", SpawnPlace(-6.0, 0.0)), "`crate` would be inside `"),
        (made("box", SpawnPlace(-4.6, 0.0)), "`box` would be inside `rover`"),
        (made("rover", SpawnPlace(-4.2, 0.0), "second"), "`second` starts inside `rover`"),
        (
            replace(made("box"), materials={}, solids=(Solid("a", Box((1.0,) * 3), "jelly"),)),
            "jelly",
        ),
    ],
)
def test_invalid_additions_are_refused(lab: Scenario, more: Addition, problem: str) -> None:
    rover = lab.vehicles[0]
    moving = vehicle_bodies("rover", rover.model, (-4.6, 0.0, 0.165), (0.0, 0.0, 0.0, 1.0))
    with pytest.raises(UserError, match=problem):
        with_more(lab, more, moving, seconds=0.0)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("rover", "`rover` is the run's only vehicle"),
        ("table_0", "`table_0` is part of the world and cannot be removed"),
        ("room_floor", "cannot be removed; expected a vehicle"),
        ("cluttr_3", "no vehicle or object `cluttr_3`; did you mean `clutter_3`"),
    ],
)
def test_invalid_removals_are_refused(lab: Scenario, name: str, problem: str) -> None:
    with pytest.raises(UserError, match=problem):
        without(lab, name)
