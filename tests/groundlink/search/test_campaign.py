# SPDX-License-Identifier: Apache-2.0
"""A campaign has a cell for each fault that a sensor can have."""

import pytest

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.scenario.faults import KINDS
from groundlink.search.campaign import (
    BEGIN,
    FAULT,
    LINK,
    PARAMETERS,
    SENSOR,
    CampaignCell,
    cells,
    link_condition,
)

SCENARIO = load("indoor_lab_tour")


def chosen(
    *faults: str, sensors: tuple[str, ...] = (), begins_s: tuple[float, ...] = (1.0,)
) -> list[CampaignCell]:
    return cells(SCENARIO, sensors=sensors, faults=faults, begins_s=begins_s, for_s=2.0)


def test_every_kind_is_given_to_each_sensor_that_can_have_it() -> None:
    kinds: dict[str, list[str]] = {}
    for cell in chosen():
        kinds.setdefault(cell.values[SENSOR], []).append(cell.values[FAULT])
    others = [kind for kind in KINDS if kind != "occluded_sector"]
    assert kinds == {"rover/lidar": [*KINDS], "rover/imu": others, "rover/encoders": others}


def test_scenario_with_each_cell_is_valid_and_has_its_fault() -> None:
    for cell in chosen("off", "bias", "rate_change"):
        changed = load("indoor_lab_tour", changes=cell.changes)
        name = cell.values[SENSOR].removeprefix("rover/")
        (sensor,) = (s for s in changed.vehicles[0].sensors if s.name == name)
        (fault,) = sensor.faults
        assert (fault.kind, fault.at_s, fault.for_s) == (cell.values[FAULT], 1.0, 2.0)


def test_faults_of_the_scenario_stay() -> None:
    before = {"kind": "drop", "at_s": 0.5, "share": 0.1}
    (first,) = chosen(f"{before}", sensors=("rover/imu",))
    faulty = load("indoor_lab_tour", changes=first.changes)
    (cell,) = cells(faulty, sensors=["rover/imu"], faults=["stuck"], begins_s=[4.0], for_s=None)
    (change,) = cell.changes
    assert [fault["kind"] for fault in change.value] == ["drop", "stuck"]
    assert change.value[1] == {"kind": "stuck", "at_s": 4.0}


@pytest.mark.parametrize(
    ("fault", "sensor", "text"),
    [
        ("bias", "rover/imu", "rover/imu bias (for_s: 2.0, value: 1.0) from 3 s"),
        ("bias", "rover/lidar", "rover/lidar bias (for_s: 2.0, value: 0.5) from 3 s"),
        ("rate_change", "rover/imu", "rover/imu rate_change (for_s: 2.0, rate_hz: 200.0) from 3 s"),
        (
            "{kind: bias, value: [0, 0, 2], quantity: angular_velocity}",
            "rover/imu",
            "rover/imu bias (for_s: 2.0, quantity: angular_velocity, value: (0.0, 0.0, 2.0)) from "
            "3 s",
        ),
    ],
)
def test_cell_as_text(fault: str, sensor: str, text: str) -> None:
    (cell,) = chosen(fault, sensors=(sensor,), begins_s=(3.0,))
    assert str(cell) == text
    assert cell.values[BEGIN] == 3.0
    assert cell.values[PARAMETERS] in text


def test_times_multiply_cells() -> None:
    found = chosen("stuck", begins_s=(1.0, 2.0))
    assert [(cell.values[SENSOR], cell.values[BEGIN]) for cell in found] == [
        (f"rover/{name}", at) for name in ("lidar", "imu", "encoders") for at in (1.0, 2.0)
    ]


LOSSY = "{to_ros: {loss: 0.1, burst: 4}, events: [{at_s: 2, from_ros: {outage: true}}]}"


def over(*links: str, faults: tuple[str, ...] = ("off",)) -> list[tuple[str | None, str, str]]:
    found = cells(
        SCENARIO, sensors=["rover/imu"], faults=faults, begins_s=[1.0], for_s=None, links=links
    )
    return [(c.values[SENSOR], c.values[FAULT], c.values[LINK]) for c in found]


def test_each_fault_is_combined_with_each_link() -> None:
    assert over("none", LOSSY) == [("rover/imu", "off", "none"), ("rover/imu", "off", LOSSY)]
    assert over("none", LOSSY, faults=("none", "off"))[0] == (None, "none", LOSSY)
    assert over(LOSSY, faults=("none",)) == [(None, "none", LOSSY)]
    assert over(LOSSY, faults=())[:2] == [(None, "none", LOSSY), ("rover/imu", "off", LOSSY)]
    assert LINK not in chosen("off")[0].values


def test_scenario_with_a_link_is_valid_and_has_it() -> None:
    (cell,) = cells(
        SCENARIO, sensors=(), faults=["none"], begins_s=[1.0], for_s=None, links=[LOSSY]
    )
    link = load("indoor_lab_tour", changes=cell.changes).gateway.link
    assert link == link_condition(LOSSY).script
    assert str(cell) == f"no fault, link {LOSSY}"


def test_impairments_of_a_link_are_those_that_it_ever_has() -> None:
    link = link_condition(LOSSY)
    assert link.impairments("to_ros") == ["loss", "burst"]
    assert link.impairments("from_ros") == ["outage"]
    assert link_condition("none").impairments("to_ros") == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("{to_ros: {los: 0.1}}", "--link {to_ros: {los: 0.1}}: object contains unknown field"),
        ("{to_ros: {loss: 2}}", "expected `float` <= 1.0"),
        ("bad", "--link bad: expected `object`, got `str`"),
    ],
)
def test_mistake_in_a_link_is_one_line(text: str, line: str) -> None:
    with pytest.raises(UserError) as error:
        over(text)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("faults", "sensors", "line"),
    [
        (("stock",), (), "--fault stock: no such kind; did you mean `stuck`?"),
        (("{kind: drop}",), (), "--fault {kind: drop}: object missing required field `share`"),
        (("{kind: drop, share: 2}",), (), "`share`: expected `float` <= 1.0"),
        (("occluded_sector",), ("rover/imu",), "none of the sensors can have it"),
        ((), ("rover/imo",), "--sensors rover/imo: no such sensor; did you mean `rover/imu`?"),
    ],
)
def test_mistake_is_one_line(faults: tuple[str, ...], sensors: tuple[str, ...], line: str) -> None:
    with pytest.raises(UserError) as error:
        chosen(*faults, sensors=sensors)
    assert line in str(error.value)
    assert "\n" not in str(error.value)
