# SPDX-License-Identifier: Apache-2.0
"""What an expectation refers to must be there; the error names the field."""

from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.expectations.scope import estimates, mistakes, parts_of, place_of
from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.expectations import Reaches
from groundlink.scenario.schema import NamedPose

from .conftest import Expecting

CORNER = {"kind": "reaches", "place": [1, 2]}


@pytest.mark.parametrize(
    ("fields", "field", "words"),
    [
        ({"kind": "reaches", "place": "goal"}, "place", "no pose or checkpoint `goal`"),
        (CORNER | {"vehicle": "rver"}, "vehicle", "did you mean `rover`?"),
        ({"kind": "never_touches", "allowed": ["hal"]}, "allowed", "did you mean `hall`?"),
        ({"kind": "position_error", "topic": "/gps", "at_most_m": 1}, "topic", "no estimated pose"),
        (
            {"kind": "heading_error", "topic": "/ground_truth/odom", "at_most_deg": 1},
            "topic",
            "expected one of /odom, /pose",
        ),
        ({"kind": "rate", "topic": "/odm", "at_least_hz": 1}, "topic", "did you mean `/odom`?"),
        ({"kind": "age", "topic": "/odm", "at_most_ms": 1}, "topic", "did you mean `/odom`?"),
    ],
)
def test_a_mistake_names_the_field(
    expecting: Expecting, fields: dict[str, Any], field: str, words: str
) -> None:
    (found,) = mistakes(expecting(CORNER, fields))
    assert found.path == ("expect", 1, field)
    assert words in found.text


@pytest.mark.parametrize("kind", ["completes_route", "stays_on_route"])
def test_a_route_is_needed(expecting: Expecting, kind: str) -> None:
    more = {"within_m": 1} if kind == "stays_on_route" else {}
    scenario = expecting({"kind": kind, **more})
    assert not list(mistakes(scenario))
    without = replace(scenario, vehicles=(replace(scenario.vehicles[0], route=None),))
    assert [one.text for one in mistakes(without)] == [
        "`rover` has no route. Fix: add `route` to the vehicle"
    ]


def test_names_are_unique(expecting: Expecting) -> None:
    (found,) = mistakes(expecting(CORNER, CORNER | {"within_m": 1}))
    assert found.path == ("expect", 1, "name")
    assert "`reaches 1,2`" in found.text
    assert not list(mistakes(expecting(CORNER, CORNER | {"name": "again"})))


def test_of_several_vehicles_one_is_named(expecting: Expecting) -> None:
    one = expecting(CORNER)
    two = replace(one, vehicles=(*one.vehicles, replace(one.vehicles[0], name="other")))
    (found,) = mistakes(two)
    assert found.text == "expected one of rover, other, since there are several vehicles"


def test_every_topic_of_a_scenario_is_known(expecting: Expecting) -> None:
    known = ("/clock", "/cmd_vel", "/odom", "/pose", "/joint_states", "/tf", "/ground_truth/odom")
    rates = [{"kind": "rate", "topic": topic, "at_least_hz": 1} for topic in known]
    assert not list(mistakes(expecting(*rates)))


def test_a_place_is_a_pose_or_a_checkpoint(drive: Scenario) -> None:
    track = load("track")
    assert place_of(Reaches(place="cp_3"), track) == (0.0, 0.0)
    poses = {"goal": NamedPose(position_m=(1.0, 2.0, 3.0))}
    named = replace(drive, world=replace(drive.world, poses=poses))
    assert place_of(Reaches(place="goal"), named) == (1.0, 2.0)
    assert place_of(Reaches(place="goal"), drive) is None


def test_an_entity_stands_for_its_parts(lab: Scenario) -> None:
    assert "table_0_leg_1" in parts_of("table_0", lab)
    assert parts_of("wall_north_whole", lab) == {"wall_north_whole"}
    assert parts_of("rover", lab) == {"rover"}
    assert not parts_of("cupboard", lab)


def test_estimates_are_those_of_stack_and_wheels(drive: Scenario) -> None:
    assert {topic: vehicle.name for topic, (vehicle, _) in estimates(drive, "run").items()} == {
        "/odom": "rover",
        "/pose": "rover",
    }
