# SPDX-License-Identifier: Apache-2.0
"""Spawning, deleting, named poses and worlds."""

from collections.abc import Callable
from math import nan
from types import SimpleNamespace
from typing import Any

import pytest

from udp_bridge.node.command_client import CommandFailed
from udp_bridge.wire.run_commands import PAUSED

from .conftest import Served, Simulator

UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
STOPPED, PLAYING, LOADING_WORLD = 0, 1, 5
LOADING_CODES = {
    "unsupported_format": 101,
    "no_resource": 102,
    "parse_error": 103,
    "missing_assets": 104,
    "not_found": NOT_FOUND,
    "incorrect_state": INCORRECT_STATE,
    "failed": FAILED,
}
Message = Callable[..., Any]


def test_a_request_to_spawn_is_passed_on(served: Served, messages: Message) -> None:
    served.simulator.answers["spawn"] = {"name": "crate_2"}
    response = served.call(
        "spawn_entity",
        name="crate",
        allow_renaming=True,
        entity_resource=messages("Resource", uri="crate", resource_string="ignored"),
        entity_namespace="yard",
        initial_pose__header__frame_id="rover",
        initial_pose__pose__position=messages("Point", x=2.0),
    )
    assert (response.result.result, response.entity_name) == (OK, "crate_2")
    asked = {
        "query": "spawn",
        "name": "crate",
        "position_m": [2, 0, 0],
        "orientation": [0, 0, 0, 1],
        "frame": "rover",
        "uri": "crate",
        "text": "",
        "allow_renaming": True,
        "namespace": "yard",
    }
    assert served.simulator.queries == [asked]
    served.call("spawn_entity", entity_resource=messages("Resource", resource_string="solids: []"))
    assert served.simulator.queries[-1]["text"] == "solids: []"


@pytest.mark.parametrize(
    ("code", "result"),
    [
        ("name_taken", 101),
        ("name_invalid", 102),
        ("unsupported_format", 103),
        ("no_resource", 104),
        ("namespace_invalid", 105),
        ("parse_error", 106),
        ("missing_assets", 107),
        ("invalid_pose", 109),
        ("not_found", NOT_FOUND),
        ("incorrect_state", INCORRECT_STATE),
        ("unsupported", UNSUPPORTED),
        ("failed", FAILED),
        ("no_world", FAILED),
        ("of_a_later_version", FAILED),
    ],
)
def test_refusals_have_the_codes_of_the_standard(served: Served, code: str, result: int) -> None:
    served.simulator.refuse("spawn", code, "one line")
    assert served.result("spawn_entity", name="crate") == (result, "one line")


def test_several_are_spawned_one_after_another(served: Served, messages: Message) -> None:
    good = messages("SpawnEntity", name="good")
    bad = messages("SpawnEntity", name="bad")
    bad.initial_pose.pose.orientation.w = nan
    served.simulator.answers["spawn"] = {"name": "good"}
    response = served.call("spawn_entities", spawn_requests=[good, bad, good])
    assert (response.result.result, response.result.error_message) == (
        150,
        "1 of 3 were not spawned",
    )
    results = [(row.result.result, row.entity_name) for row in response.results]
    assert results == [(OK, "good"), (109, ""), (OK, "good")]
    assert len(served.simulator.queries) == 2
    assert served.result("spawn_entities", spawn_requests=[good]) == (OK, "")
    assert served.result("spawn_entities") == (OK, "")


def test_a_request_of_version_1_has_its_uri_itself(served: Served) -> None:
    from udp_bridge_ros2.standard_services.messages import read_resource

    assert read_resource(SimpleNamespace(uri="a", resource_string="b"), "entity_resource") == (
        "a",
        "b",
    )


def test_delete(served: Served) -> None:
    assert served.result("delete_entity", entity="crate") == (OK, "")
    assert served.simulator.queries == [{"query": "remove", "name": "crate"}]
    served.simulator.refuse("remove", "not_found", "no entity `crate`")
    assert served.result("delete_entity", entity="crate") == (NOT_FOUND, "no entity `crate`")
    served.simulator.fail("remove")
    assert served.result("delete_entity", entity="crate") == (FAILED, "no gateway found")


def test_spawnables_have_their_boxes(served: Served) -> None:
    row = {"uri": "crate", "description": "10 kg", "low_m": [0, 0, 0], "high_m": [1, 2, 3]}
    boxless = row | {"uri": "mist", "low_m": None, "high_m": None}
    answers = {"spawnables": [row, boxless], "unknown": ["ftp://x"]}
    served.simulator.answers["spawnables"] = answers
    response = served.call("get_spawnables", sources=["ftp://x"])
    assert served.simulator.queries == [{"query": "spawnables", "sources": ["ftp://x"]}]
    assert (response.result.result, response.result.error_message) == (
        OK,
        "unrecognized sources: ftp://x",
    )
    first, second = response.spawnables
    assert (first.entity_resource.uri, first.description) == ("crate", "10 kg")
    assert (first.spawn_bounds.type, first.spawn_bounds.points[0].z) == (1, 3)
    assert second.spawn_bounds.type == 0


def test_named_poses(served: Served) -> None:
    row = {
        "name": "dock",
        "description": "charger",
        "tags": ["parking"],
        "position_m": [1, 2, 3],
        "orientation": [0, 0, 1, 0],
        "low_m": [-1, -1, 0],
        "high_m": [1, 1, 2],
    }
    bare = row | {"name": "gate", "tags": [], "low_m": None, "high_m": None}
    served.simulator.answers["named_poses"] = {"poses": [row, bare]}
    first, second = served.call("get_named_poses").poses
    assert (first.name, first.description, first.tags) == ("dock", "charger", ["parking"])
    assert (first.pose.position.y, first.pose.orientation.z, second.name) == (2, 1, "gate")
    (found,) = served.call("get_named_poses", tags__tags=["parking"]).poses
    assert found == first
    bounds = served.call("get_named_pose_bounds", name="dock").bounds
    assert (bounds.type, bounds.points[0].z, bounds.points[1].x) == (1, 2, -1)
    assert served.call("get_named_pose_bounds", name="gate").bounds.type == 0
    assert served.result("get_named_pose_bounds", name="x") == (NOT_FOUND, "no named pose 'x'")


def test_worlds(served: Served) -> None:
    row = {"name": "lab", "uri": "indoor_lab", "description": "a lab", "tags": ["indoor"]}
    served.simulator.answers["world"] = {"world": row}
    world = served.call("get_current_world").world
    assert (world.name, world.world_resource.uri, world.description, world.tags) == (
        *("lab", "indoor_lab", "a lab"),
        ["indoor"],
    )
    served.simulator.refuse("world", "no_world")
    assert served.result("get_current_world")[0] == 101

    answer: dict[str, Any] = {"worlds": [row, row | {"name": "yard", "tags": []}], "unknown": []}
    served.simulator.answers["worlds"] = answer
    listed = served.call("get_available_worlds", filter__tags=["indoor", "x"])
    assert [world.name for world in listed.worlds] == ["lab"]
    answer["unknown"] = ["/nowhere"]
    asked = {"additional_sources": ["/nowhere"]}
    assert served.result("get_available_worlds", **asked) == (
        FAILED,
        "unrecognized sources: /nowhere",
    )
    listed = served.call("get_available_worlds", **asked, continue_on_error=True)
    assert (listed.result.result, len(listed.worlds)) == (OK, 2)
    assert served.simulator.queries[-1] == {"query": "worlds", "sources": ["/nowhere"]}


def test_a_loaded_world_is_told_and_leaves_the_simulation_stopped(served: Served) -> None:
    simulator = served.simulator
    row = {"name": "a", "uri": "", "description": "", "tags": [], "text": "name: a"}
    simulator.answers["load_world"] = {"world": row}
    simulator.state, simulator.tick = PAUSED, 0  # as physics leaves it
    loaded = served.call("load_world", world_resource__resource_string="name: a").world
    assert (loaded.name, loaded.world_resource.resource_string) == ("a", "name: a")
    assert simulator.queries == [{"query": "load_world", "uri": "", "text": "name: a"}]
    assert served.call("get_simulation_state").state.state == STOPPED
    served.call("load_world", world_resource__uri="b", world_resource__resource_string="c")
    assert simulator.queries[-1] == {"query": "load_world", "uri": "b", "text": ""}
    for code, number in LOADING_CODES.items():
        simulator.refuse("load_world", code)
        assert served.result("load_world") == (number, "no")
    assert served.result("unload_world") == (OK, "")
    simulator.refuse("unload_world", "no_world")
    assert served.result("unload_world") == (101, "no")


def test_a_world_is_loading_until_physics_answers(served: Served) -> None:
    told = []

    def ask(text: str) -> str:
        told.append(served.call("get_simulation_state").state.state)
        told.append(served.result("set_simulation_state", state__state=PLAYING)[0])
        raise CommandFailed("silence")

    simulator = Simulator()
    simulator.ask = ask  # type: ignore[method-assign]
    served = Served(simulator)
    assert served.result("load_world", world_resource__uri="yard") == (FAILED, "silence")
    assert told == [LOADING_WORLD, 103]
    assert served.call("get_simulation_state").state.state == PLAYING
