# SPDX-License-Identifier: Apache-2.0
"""Readings that never came to the gateway are counted by topic, and nothing else is."""

from __future__ import annotations

import pytest

from groundlink.calendars import calendar
from groundlink.scenario import load
from groundlink.scenario.load import SHIPPED
from services.gateway.attendance import Attendance

SCENARIO = load(SHIPPED / "indoor_lab.yaml")
VEHICLE = SCENARIO.vehicles[0]
STREAMS = {"lidar": "/points", "imu": "/imu", "encoders": "/wheel_encoders"}


def came(attendance: Attendance, sensor: str, readings: list[int]) -> None:
    (spec,) = (spec for spec in VEHICLE.sensors if spec.name == sensor)
    for reading in readings:
        attendance.came(f"groundlink/lab/rover/{sensor}", calendar(spec).nanos(reading))


@pytest.mark.parametrize("sensor", STREAMS)
@pytest.mark.parametrize(
    ("readings", "not_come"),
    [([7, 8, 9], 0), ([7, 9], 1), ([7, 10, 11, 15], 5), ([12], 0)],
)
def test_what_is_left_out_between_two_is_counted(
    sensor: str, readings: list[int], not_come: int
) -> None:
    attendance = Attendance(SCENARIO, "lab")
    came(attendance, sensor, readings)
    attendance.clock(has_begun=False)
    assert attendance.counters().get(f"not_come_{STREAMS[sensor]}", 0) == not_come


def test_another_life_is_no_gap_even_where_a_reading_is_ahead_of_the_clock() -> None:
    attendance = Attendance(SCENARIO, "lab")
    came(attendance, "imu", [20, 22])
    attendance.clock(has_begun=False)
    came(attendance, "imu", [5000])
    attendance.clock(has_begun=True)
    came(attendance, "imu", [3, 4])
    attendance.clock(has_begun=False)
    assert attendance.counters() == {"not_come_/imu": 1}


def test_what_is_no_reading_is_passed_over() -> None:
    attendance = Attendance(SCENARIO, "lab")
    attendance.came("groundlink/lab/clock", 10)
    attendance.came("groundlink/lab/clock", 10_000_000_000)
    attendance.clock(has_begun=False)
    assert attendance.counters() == {}
