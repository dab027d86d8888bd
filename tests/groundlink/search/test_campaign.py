# SPDX-License-Identifier: Apache-2.0
"""A campaign has a cell for each fault that a sensor can have."""

import pytest

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.scenario.faults import KINDS
from groundlink.search.campaign import BEGIN, FAULT, PARAMETERS, SENSOR, FaultCell, cells

SCENARIO = load("indoor_lab_tour")


def chosen(
    *faults: str, sensors: tuple[str, ...] = (), begins_s: tuple[float, ...] = (1.0,)
) -> list[FaultCell]:
    return cells(SCENARIO, sensors=sensors, faults=faults, begins_s=begins_s, for_s=2.0)


def test_every_kind_is_given_to_each_sensor_that_can_have_it() -> None:
    kinds: dict[str, list[str]] = {}
    for cell in chosen():
        kinds.setdefault(cell.values[SENSOR], []).append(cell.values[FAULT])
    others = [kind for kind in KINDS if kind != "occluded_sector"]
    assert kinds == {"rover/lidar": [*KINDS], "rover/imu": others, "rover/encoders": others}


def test_scenario_with_each_cell_is_valid_and_has_its_fault() -> None:
    for cell in chosen("off", "bias", "rate_change"):
        changed = load("indoor_lab_tour", changes=[cell.change])
        (sensor,) = (s for s in changed.vehicles[0].sensors if s.name == cell.sensor.name)
        (fault,) = sensor.faults
        assert (fault.kind, fault.at_s, fault.for_s) == (cell.values[FAULT], 1.0, 2.0)


def test_faults_of_the_scenario_stay() -> None:
    before = {"kind": "drop", "at_s": 0.5, "share": 0.1}
    (first,) = chosen(f"{before}", sensors=("rover/imu",))
    faulty = load("indoor_lab_tour", changes=[first.change])
    (cell,) = cells(faulty, sensors=["rover/imu"], faults=["stuck"], begins_s=[4.0], for_s=None)
    assert [fault["kind"] for fault in cell.change.value] == ["drop", "stuck"]
    assert cell.change.value[1] == {"kind": "stuck", "at_s": 4.0}


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
