# SPDX-License-Identifier: Apache-2.0
"""Entities: what clients get of them and what physics is asked for."""

from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from .conftest import Served

UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
INVALID_POSE = 101
Message = Callable[..., Any]

ROVER: dict[str, Any] = {
    "name": "rover",
    "category": "robot",
    "description": "a rover",
    "tags": ["red"],
    "is_static": False,
    "position_m": [1, 2, 0.5],
    "orientation": [0, 0, 0.6, 0.8],
    "linear_mps": [0.1, 0.2, 0.3],
    "angular_radps": [0.4, 0.5, 0.6],
    "linear_mps2": [1, 2, 3],
    "angular_radps2": [4, 5, 6],
    "low_m": [-0.5, -0.25, -0.1],
    "high_m": [0.5, 0.25, 0.2],
}
WALL = ROVER | {
    "name": "wall",
    "category": "static_object",
    "tags": [],
    "is_static": True,
    "position_m": [9, 0, 0],
}


@pytest.fixture
def world(served: Served) -> Served:
    served.simulator.answers["entities"] = {"entities": [ROVER, WALL]}
    return served


def xyz(vector: Any) -> tuple[float, float, float]:
    return (vector.x, vector.y, vector.z)


def only(served: Served, row: dict[str, Any]) -> None:
    """Let the world have one entity, as queries by its name find it."""
    served.simulator.answers["entities"] = {"entities": [row]}


@pytest.mark.parametrize("service", ["get_entities", "get_entities_states"])
def test_filters_select_entities(world: Served, messages: Message, service: str) -> None:
    def found(**fields: Any) -> list[str]:
        response = world.call(service, **fields)
        assert response.result.result == OK
        return list(response.entities)

    robot = messages("EntityCategory", category=1)
    center = messages("Vector3", x=9.0)
    radius = messages("Vector3", x=1.0, y=7.0)
    sphere = messages("Bounds", type=3, points=[center, radius])
    corners = [messages("Vector3", x=2.0, y=3.0, z=1.0), messages("Vector3")]
    box = messages("Bounds", type=1, points=corners)
    hull = messages("Bounds", type=2, points=[*corners, messages("Vector3", x=2.0)])
    assert found() == ["rover", "wall"]
    assert found(filters__filter="w.*") == ["wall"]
    assert found(filters__categories=[robot]) == ["rover"]
    assert found(filters__tags__tags=["red", "big"]) == ["rover"]
    assert found(filters__tags__tags=["red", "big"], filters__tags__filter_mode=1) == []
    assert found(filters__bounds=sphere) == ["wall"]
    assert found(filters__bounds=box) == found(filters__bounds=hull) == ["rover"]
    assert found(filters__bounds=box, filters__filter="w.*") == []


def test_filters_that_cannot_be(world: Served, messages: Message) -> None:
    def code(**fields: Any) -> int:
        return world.result("get_entities", **fields)[0]

    point = messages("Vector3", x=1.0)
    for number, count, wanted in ((1, 3, FAILED), (2, 2, FAILED), (3, 1, FAILED), (4, 2, 0)):
        bounds = messages("Bounds", type=number, points=[point] * count)
        assert code(filters__bounds=bounds) == wanted
    inside_out = messages("Bounds", type=3, points=[point, messages("Vector3", x=-1.0)])
    infinite = messages("Bounds", type=3, points=[point, messages("Vector3", x=inf)])
    assert code(filters__bounds=inside_out) == code(filters__bounds=infinite) == FAILED
    assert code(filters__categories=[messages("EntityCategory", category=3)]) == FAILED
    assert code(filters__tags__filter_mode=2) == FAILED
    result = world.result("get_entities", filters__filter="a(")
    assert result == (FAILED, "regular expression 'a(', position 2: '(' without ')'")
    assert world.simulator.queries == []


def test_state_is_in_the_frame_of_the_world(world: Served) -> None:
    only(world, ROVER)
    response = world.call("get_entity_state", entity="rover")
    assert response.result.result == OK
    assert world.simulator.queries == [{"query": "entities", "name": "rover"}]
    state = response.state
    assert (state.header.frame_id, state.header.stamp.sec, state.header.stamp.nanosec) == (
        *("world", 1),
        2,
    )
    turn = state.pose.orientation
    assert (*xyz(state.pose.position), *xyz(turn), turn.w) == (1, 2, 0.5, 0, 0, 0.6, 0.8)
    assert (*xyz(state.twist.linear), *xyz(state.twist.angular)) == (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    assert (*xyz(state.acceleration.linear), *xyz(state.acceleration.angular)) == (
        *(1, 2, 3),
        *(4, 5, 6),
    )


def test_state_that_is_set(world: Served, messages: Message) -> None:
    def placed(**fields: Any) -> tuple[int, dict[str, Any]]:
        world.simulator.queries.clear()
        code, _ = world.result("set_entity_state", entity="rover", **fields)
        return code, world.simulator.queries[-1] if world.simulator.queries else {}

    only(world, ROVER)
    untouched = {
        "query": "place",
        "name": "rover",
        "position_m": None,
        "orientation": None,
        "linear_mps": None,
        "angular_radps": None,
        "frame": "",
    }
    posed = {"position_m": [1, 2, 0], "orientation": [0, 0, 0, 1]}
    moving = {"linear_mps": [0.5, 0, 0], "angular_radps": [0, 0, 0]}
    fields = {
        "state__pose__position": messages("Point", x=1.0, y=2.0),
        "state__twist__linear": messages("Vector3", x=0.5),
    }
    assert placed(**fields) == (OK, untouched)
    assert placed(**fields, set_pose=True) == (OK, untouched | posed)
    assert placed(**fields, set_twist=True) == (OK, untouched | moving)
    on = {"set_pose": True, "state__header__frame_id": "wall"}
    assert placed(**fields, **on) == (OK, untouched | posed | {"frame": "wall"})
    on["state__header__frame_id"] = "world"
    assert placed(**fields, **on) == (OK, untouched | posed)
    only(world, ROVER | {"is_static": True})
    code, asked = placed(**fields, set_twist=True)
    assert (code, asked["query"]) == (FAILED, "entities")
    only(world, ROVER)
    fields["state__twist__linear"] = messages("Vector3", x=nan)
    assert placed(**fields, set_twist=True) == (FAILED, {})
    fields["state__pose__position"] = messages("Point", y=inf)
    assert placed(**fields, set_pose=True) == (INVALID_POSE, {})


def test_an_acceleration_is_ignored_and_said_so(world: Served, messages: Message) -> None:
    only(world, ROVER)
    fast = messages("Vector3", x=1.0)
    asked = {"entity": "rover", "set_acceleration": True, "state__acceleration__linear": fast}
    assert world.result("set_entity_state", **asked) == (OK, "the acceleration was ignored")
    only(world, ROVER | {"is_static": True})
    code, reason = world.result("set_entity_state", **asked)
    assert (code, reason) == (FAILED, "rover is static and can't move")


def test_information_and_bounds(world: Served, messages: Message) -> None:
    only(world, ROVER)
    info = world.call("get_entity_info", entity="rover").info
    assert (info.category.category, info.description, info.tags) == (1, "a rover", ["red"])
    bounds = world.call("get_entity_bounds", entity="rover").bounds
    assert (bounds.type, [*map(xyz, bounds.points)]) == (
        1,
        [(0.5, 0.25, 0.2), (-0.5, -0.25, -0.1)],
    )
    only(world, ROVER | {"low_m": None, "high_m": None, "category": "cloud"})
    assert world.call("get_entity_bounds", entity="rover").bounds.type == 0
    assert world.call("get_entity_info", entity="rover").info.category.category == 0

    info.category.category = 5
    assert world.result("set_entity_info", entity="rover", info=info) == (OK, "")
    assert world.simulator.queries[-1] == {
        "query": "describe",
        "name": "rover",
        "category": "static_object",
        "description": "a rover",
        "tags": ["red"],
    }
    info.category.category = 3
    assert world.result("set_entity_info", entity="rover", info=info)[0] == FAILED


@pytest.mark.parametrize("service", ["get_entity_state", "get_entity_info", "get_entity_bounds"])
def test_an_entity_that_is_not_there(world: Served, service: str) -> None:
    world.simulator.refuse("entities", "not_found", "no entity `x`")
    assert world.result(service, entity="x") == (NOT_FOUND, "no entity `x`")
    assert world.result(service)[0] == NOT_FOUND
    assert len(world.simulator.queries) == 1, "a query without a name is for all"


def test_answers_that_cannot_be_read(world: Served) -> None:
    answers = world.simulator.answers
    for answer in (
        {},
        {"entities": [{}]},
        {"entities": [ROVER | {"position_m": [1, 2]}]},
        {"entities": [ROVER | {"name": 7}]},
        {"entities": ["rover"]},
        {"entities": [WALL]},
        {"entities": [ROVER], "stamp_nanos": None},
    ):
        answers["entities"] = answer
        assert world.result("get_entity_state", entity="rover")[0] == FAILED
    world.simulator.ask = lambda text: "[}"  # type: ignore[method-assign]
    assert "JSON" in Served(world.simulator).result("get_entities")[1]
    world.simulator.ask = lambda text: "[]"  # type: ignore[method-assign]
    assert "JSON" in Served(world.simulator).result("get_entities")[1]
