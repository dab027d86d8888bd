# SPDX-License-Identifier: Apache-2.0
"""GetEntities and GetEntitiesStates: each filter alone, and filters together."""

from collections.abc import Callable
from typing import Any

import pytest
from simulation_interfaces.msg import EntityCategory, EntityFilters, EntityInfo, Result, TagsFilter
from simulation_interfaces.srv import GetEntities, GetEntitiesStates, GetEntityBounds, SetEntityInfo

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail
from simulation_interfaces_tck.scene import OK, SimulatorScene
from simulation_interfaces_tck.shapes import (
    box,
    cube,
    distance,
    octahedron,
    place_of,
    pose_at,
    sphere,
    stamped,
)

FAR = (5000.0, 5000.0, 5000.0)

HUMAN = EntityCategory.CATEGORY_HUMAN
OBJECT = EntityCategory.CATEGORY_DYNAMIC_OBJECT


def matching(scene: SimulatorScene, **filters: Any) -> set[str]:
    """Return those entities of this session that a filter lets through."""
    response = scene.simulator.expect(
        (OK, Result.RESULT_NOT_FOUND), GetEntities, filters=EntityFilters(**filters)
    )
    return {name for name in response.entities if name.startswith(scene.prefix)}


def must_match(scene: SimulatorScene, wanted: set[str], **filters: Any) -> None:
    """Fail unless a filter lets these entities of the session through, and no other of them."""
    got = matching(scene, **filters)
    if got != wanted:
        fail(f"GetEntities: expected {sorted(wanted)}, got {sorted(got)}; filters: {filters}")


def categories(*wanted: int) -> list[Any]:
    """Return a filter's categories."""
    return [EntityCategory(category=category) for category in wanted]


def describe(
    scene: SimulatorScene, name: str, category: int = 0, tags: tuple[str, ...] = ()
) -> None:
    """Set category and tags of an entity."""
    info = EntityInfo(category=EntityCategory(category=category), tags=[*tags])
    scene.simulator.expect(OK, SetEntityInfo, entity=name, info=info)


@clause("GetEntities.srv: entities", "GetEntities")
def test_names_are_unique(scene: SimulatorScene) -> None:
    """No name is listed twice."""
    scene.entity()
    names = scene.entities()
    if twice := sorted({name for name in names if names.count(name) > 1}):
        fail(f"GetEntities: {twice} are listed more than once")


@clause("EntityFilters.msg: filter", "GetEntities")
def test_empty_filter_returns_all(scene: SimulatorScene) -> None:
    """Without a filter, all entities are listed."""
    must_match(scene, {scene.spawn(), scene.spawn()})


@pytest.mark.parametrize(
    ("pattern", "indices"),
    [
        pytest.param("^{0}$", {0}, id="anchors"),
        pytest.param("^({0}|{1})$", {0, 1}, id="alternation"),
        pytest.param("^{prefix}_[0-9]+$", {0, 1}, id="bracket_expression"),
        pytest.param("^{prefix}_[[:digit:]]+$", {0, 1}, id="character_class"),
        pytest.param("^.{{3}}.*{end0}$", {0}, id="interval"),
        pytest.param("^{prefix}_[^0-9]+$", set(), id="negated_bracket"),
    ],
)
@clause("EntityFilters.msg: filter", "GetEntities")
def test_names_match_an_extended_regular_expression(
    scene: SimulatorScene, pattern: str, indices: set[int]
) -> None:
    """The filter is a POSIX extended regular expression."""
    names = [scene.spawn(), scene.spawn()]
    end0 = names[0].removeprefix(scene.prefix)
    expression = pattern.format(*names, prefix=scene.prefix, end0=end0)
    must_match(scene, {names[index] for index in indices}, filter=expression)


@clause("EntityFilters.msg: bounds", "GetEntities", needs=["ENTITY_STATE_GETTING"])
def test_sphere_finds_what_overlaps(scene: SimulatorScene) -> None:
    """Every simulator filters by a sphere."""
    _must_find(scene, sphere)


@clause(
    "SimulatorFeatures.msg: ENTITY_BOUNDS_BOX", "ENTITY_BOUNDS_BOX", needs=["ENTITY_STATE_GETTING"]
)
def test_box_finds_what_overlaps(scene: SimulatorScene) -> None:
    """Entities within a box are found, others are not."""
    _must_find(scene, cube)


@clause(
    "SimulatorFeatures.msg: ENTITY_BOUNDS_CONVEX",
    "ENTITY_BOUNDS_CONVEX",
    needs=["ENTITY_STATE_GETTING"],
)
def test_convex_hull_finds_what_overlaps(scene: SimulatorScene) -> None:
    """Entities within a convex hull are found, others are not."""
    _must_find(scene, octahedron)


@clause(
    "EntityFilters.msg: bounds",
    "ENTITY_BOUNDS_BOX",
    needs=["ENTITY_BOUNDS", "ENTITY_STATE_GETTING"],
)
def test_box_finds_what_it_overlaps_in_part(scene: SimulatorScene) -> None:
    """An entity is found by its extent, even if the box does not contain its origin."""
    scene.hold_still()
    name = scene.spawn(initial_pose=stamped(pose_at(scene.new_place())))
    extent = scene.simulator.expect(OK, GetEntityBounds, entity=name).bounds
    x, y, z = place_of(scene.pose_of(name).pose)
    if extent.type == extent.TYPE_SPHERE:
        front = extent.points[0].x + extent.points[1].x
    else:
        front = max(point.x for point in extent.points)
    beside = box((x + 0.8 * front, y - 10.0, z - 10.0), (x + front + 0.1, y + 10.0, z + 10.0))
    if name not in matching(scene, bounds=beside):
        fail(f"GetEntities: expected {name!r}, whose front a box overlaps; it is not listed")


def _must_find(scene: SimulatorScene, around: Callable[..., Any]) -> None:
    scene.hold_still()
    name = scene.spawn()
    here = place_of(scene.pose_of(name).pose)
    must_match(scene, {name}, bounds=around(here, 0.5))
    must_match(scene, set(), bounds=around(FAR, 0.5))


@clause("EntityFilters.msg: categories", "ENTITY_CATEGORIES", needs=["ENTITY_INFO_GETTING"])
def test_any_of_the_categories_matches(scene: SimulatorScene) -> None:
    """Entities of any of the categories are listed, others are not."""
    name = scene.spawn()
    own = scene.info_of(name).category.category
    other = HUMAN if own != HUMAN else OBJECT
    must_match(scene, {name}, categories=categories(own))
    must_match(scene, set(), categories=categories(other))
    must_match(scene, {name}, categories=categories(other, own))


@clause(
    "SimulatorFeatures.msg: ENTITY_CATEGORIES", "ENTITY_CATEGORIES", needs=["ENTITY_INFO_SETTING"]
)
def test_category_that_was_set_is_filtered_by(scene: SimulatorScene) -> None:
    """A filter knows the category that SetEntityInfo gave."""
    name, other = scene.spawn(), scene.spawn()
    describe(scene, name, HUMAN)
    describe(scene, other, OBJECT)
    must_match(scene, {name}, categories=categories(HUMAN))


@pytest.mark.parametrize(
    ("tags", "mode", "indices"),
    [
        pytest.param(["tck_a", "tck_b"], TagsFilter.FILTER_MODE_ANY, {0, 1}, id="any"),
        pytest.param(["tck_a", "tck_b"], TagsFilter.FILTER_MODE_ALL, {0}, id="all"),
        pytest.param(["tck_a"], TagsFilter.FILTER_MODE_ALL, {0}, id="one"),
        pytest.param(["tck_c"], TagsFilter.FILTER_MODE_ANY, set(), id="none"),
        pytest.param([], TagsFilter.FILTER_MODE_ALL, {0, 1, 2}, id="empty"),
    ],
)
@clause("TagsFilter.msg: filter_mode", "ENTITY_TAGS", needs=["ENTITY_INFO_SETTING"])
def test_any_or_all_tags_match(
    scene: SimulatorScene, tags: list[str], mode: int, indices: set[int]
) -> None:
    """Any tag is enough in mode ANY, each is needed in mode ALL; no tags are no filter."""
    names = [scene.spawn() for _ in range(3)]
    describe(scene, names[0], tags=("tck_a", "tck_b"))
    describe(scene, names[1], tags=("tck_b",))
    wanted = {names[index] for index in indices}
    must_match(scene, wanted, tags=TagsFilter(tags=tags, filter_mode=mode))


@clause(
    "EntityFilters.msg: categories",
    "ENTITY_CATEGORIES",
    needs=["ENTITY_TAGS", "ENTITY_INFO_SETTING"],
)
def test_filters_apply_together(scene: SimulatorScene) -> None:
    """An entity is listed if each of the filters lets it through."""
    names = [scene.spawn() for _ in range(3)]
    describe(scene, names[0], HUMAN, ("tck_a",))
    describe(scene, names[1], HUMAN)
    describe(scene, names[2], OBJECT, ("tck_a",))
    tags = TagsFilter(tags=["tck_a"])
    must_match(scene, {names[0]}, categories=categories(HUMAN), tags=tags)
    must_match(scene, set(), filter=f"^{names[1]}$", categories=categories(HUMAN), tags=tags)


@clause("GetEntitiesStates.srv: states", "ENTITY_STATE_GETTING")
def test_states_are_those_of_the_entities(scene: SimulatorScene) -> None:
    """Each listed entity has its state, at the same place in the list."""
    scene.hold_still()
    names = [scene.spawn(), scene.spawn()]
    response = scene.simulator.expect(OK, GetEntitiesStates)
    if len(response.entities) != len(response.states):
        count, states = len(response.entities), len(response.states)
        fail(f"GetEntitiesStates: expected a state for each of {count} entities, got {states}")
    listed = dict(zip(response.entities, response.states, strict=True))
    for name in names:
        if name not in listed:
            fail(f"GetEntitiesStates: expected {name!r} among {sorted(listed)}")
        if distance(listed[name].pose, scene.pose_of(name).pose) > scene.tolerance:
            fail(f"GetEntitiesStates: the pose of {name!r} is not that of GetEntityState")


@clause("GetEntitiesStates.srv: filters", "ENTITY_STATE_GETTING")
def test_states_are_filtered_alike(scene: SimulatorScene) -> None:
    """GetEntitiesStates has the filters of GetEntities."""
    name, _ = scene.spawn(), scene.spawn()
    wanted = EntityFilters(filter=f"^{name}$")
    response = scene.simulator.expect(OK, GetEntitiesStates, filters=wanted)
    if [*response.entities] != [name]:
        fail(f"GetEntitiesStates: expected {[name]}, got {[*response.entities]}")
