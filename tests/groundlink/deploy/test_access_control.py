# SPDX-License-Identifier: Apache-2.0
"""Access rules: the grants against the tables of topics and queries."""

from pathlib import Path

import pytest

from groundlink.bus.core_topics import COMMAND, STATE
from groundlink.bus.queries import control_key, faults_key, link_key, world_query_key
from groundlink.bus.topics import JOINT_COMMAND, SENSOR_TOPICS, WHEEL_COMMAND, process_names
from groundlink.deploy.access_control import OPERATOR, access_control, grants
from groundlink.loader import load
from groundlink.scenario import Scenario

SCENARIOS = Path(__file__).parents[3] / "scenarios"


@pytest.fixture
def tour() -> Scenario:
    """The default scenario with a driver."""
    return load(SCENARIOS / "indoor_lab_tour.yaml")


def who_says(scenario: Scenario, key: str) -> set[str]:
    return {process for process, grant in grants(scenario) if key in grant.publishes}


def test_every_process_of_a_run_is_granted_something(tour: Scenario) -> None:
    assert {process for process, _ in grants(tour)} > set(process_names(tour))


def test_single_physics_prints_poses(tour: Scenario) -> None:
    assert who_says(tour, STATE.key_in("*")) == {"physics"}


def test_single_sensor_prints_its_readings(tour: Scenario) -> None:
    assert who_says(tour, SENSOR_TOPICS["imu"].key_in("*", vehicle="rover", sensor="imu")) == {
        "rover/imu"
    }


def test_vehicles_obey_ros_their_driver_and_the_operator(tour: Scenario) -> None:
    own = COMMAND.key_in("*", vehicle="rover")
    assert who_says(tour, own) == {"rover/driver"}
    for row in (COMMAND, WHEEL_COMMAND, JOINT_COMMAND):
        assert who_says(tour, row.key_in("*")) == {"gateway", OPERATOR}


@pytest.mark.parametrize(
    ("key", "process"),
    [
        (control_key("*"), "physics"),
        (world_query_key("*"), "physics"),
        (link_key("*"), "gateway"),
        (faults_key("*", "rover/imu"), "rover/imu"),
    ],
)
def test_a_question_is_answered_by_the_process_that_knows(
    tour: Scenario, key: str, process: str
) -> None:
    assert {name for name, grant in grants(tour) if key in grant.serves} == {process}
    rules = {rule["id"]: rule for rule in access_control(tour)["rules"]}
    answering = rules[f"{process} serves"]
    assert f"{key}/**" in answering["key_exprs"]
    assert set(answering["messages"]) == {"declare_queryable", "reply"}


def test_what_is_not_granted_is_denied_and_no_rule_is_idle(tour: Scenario) -> None:
    control = access_control(tour)
    assert control["default_permission"] == "deny"
    used = {rule for policy in control["policies"] for rule in policy["rules"]}
    assert used == {rule["id"] for rule in control["rules"]}
    assert all(rule["permission"] == "allow" for rule in control["rules"])


def test_what_each_process_may_ask_is_what_the_rules_name_and_no_more(tour: Scenario) -> None:
    control = access_control(tour)
    asks = {r["id"]: r["key_exprs"] for r in control["rules"] if r["messages"] == ["query"]}
    assert asks == {
        "query": [
            *(f"groundlink/*/{what}/**" for what in ("scenario", "assets", "state/history")),
            *(f"groundlink/*/{what}/**" for what in ("journal", "ruts")),
        ],
        "control": ["groundlink/*/control/**", "groundlink/*/world/**"],
        "operate": ["groundlink/**"],
    }
    more = {OPERATOR: {"operate"}, "gateway": {"control"}}
    may_ask = [(p["subjects"], asks.keys() & set(p["rules"])) for p in control["policies"]]
    expected = [([name], {"query"} | more.get(name, set())) for name, _ in grants(tour)]
    assert sorted(may_ask) == sorted(expected)
