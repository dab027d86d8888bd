# SPDX-License-Identifier: Apache-2.0
"""Vitals, faults and gaps become messages of ROS's own types, and come back from them."""

from collections import Counter
from typing import Any

import pytest

from groundlink.episode.fault_messages import Faults, counted, kinds_in
from groundlink.messages.base import BusMessage
from groundlink.messages.ground_truth import BatteryState, Contact, InWater, Vitals, WheelInSoil
from groundlink.messages.missing_readings import (
    Cause,
    MissingReadings,
    MissingSpan,
    counters_of,
    in_words,
    parted,
)
from groundlink.ros.cdr import to_cdr
from groundlink.ros.diagnostics import (
    DIAGNOSTICS_TYPE,
    from_faults,
    from_missing_readings,
    from_vitals,
)
from groundlink.ros.types import STORE
from groundlink.scenario.faults import Bias, Stuck

CALM = Vitals(2_500_000_000, "rover", 1000, 35.114, 4.25, ())
DROWNED = Vitals(
    *(2_500_000_000, "rover", 1000, 35.114, 4.25, ()), water=InWater(depth_m=0.4375, drowned=True)
)
HIT = Vitals(
    *(2_600_000_000, "rover", 1040, 36.5, 4.25),
    (Contact("table_3_leg_1", 9681.88, 1036, 4), Contact("wall_east_whole", 0.5, 1020, 1)),
    BatteryState(0.5, 24.5, 3.25),
    (WheelInSoil("front_left_wheel", 0.25, 0.0325), WheelInSoil("rear_left_wheel", -0.5, 0.04)),
)
NONE = Faults(2_500_000_000, "rover/imu", 1000, ())
TWO = Faults(
    *(2_600_000_000, "rover/imu", 1040),
    (Stuck(at_s=2.6, for_s=5.0), Bias(value=(0.0, 0.0, 0.25), quantity="angular_velocity")),
)
GAPS = MissingReadings(
    *(2_600_000_000, "rover/camera"),
    (
        MissingSpan("overloaded", 0, 66_666_666, 3, ("", "camera_info")),
        MissingSpan("drop", 100_000_000, 100_000_000, 1, ("",)),
        MissingSpan("overloaded", 200_000_000, 200_000_000, 1, ("", "camera_info")),
    ),
)
READERS = {Vitals: from_vitals, Faults: from_faults, MissingReadings: from_missing_readings}


def array_of(message: BusMessage) -> Any:
    return STORE.deserialize_cdr(to_cdr(message), DIAGNOSTICS_TYPE)


@pytest.mark.parametrize(
    ("message", "name", "level", "told"),
    [
        (CALM, "rover: vitals", 0, "touches nothing"),
        (DROWNED, "rover: vitals", 2, "motors have drowned, touches nothing"),
        (HIT, "rover: vitals", 1, "touches table_3_leg_1, wall_east_whole"),
        (NONE, "rover/imu: faults", 0, "none"),
        (TWO, "rover/imu: faults", 2, "stuck, bias"),
        (GAPS, "rover/camera: gaps", 1, "4 overloaded, 1 drop"),
    ],
)
def test_they_come_back_as_they_went_and_a_person_can_read_them(
    message: Any, name: str, level: int, told: str
) -> None:
    array = array_of(message)
    assert READERS[type(message)](array) == message
    [status] = array.status
    assert (status.name, status.level, status.message) == (name, level, told)


@pytest.mark.parametrize(
    ("message", "reason"),
    [(HIT, "no value 'tick'"), (TWO, "no value `tick`"), (GAPS, "cause")],
)
def test_other_diagnostics_are_refused(message: Any, reason: str) -> None:
    array, read = array_of(message), READERS[type(message)]
    if message is GAPS:
        array.status[0].values[0].value = "{}"
    else:
        array.status[0].values = array.status[0].values[1:]
    with pytest.raises(ValueError, match=reason):
        read(array)
    array.status = []
    with pytest.raises(ValueError, match="0 statuses"):
        read(array)


def test_counters_tell_them_to_whom_looks_on() -> None:
    counters = {"readings": 5} | counted((Stuck(), Stuck(at_s=1.0), Bias(value=1.0)))
    assert counters == {"readings": 5, "fault_stuck": 2, "fault_bias": 1}
    assert kinds_in(counters) == ["stuck", "bias"]
    assert kinds_in({"readings": 5}) == []
    missing: Counter[Cause] = Counter({"overloaded": 4, "restarted": 1})
    assert parted({"readings": 5} | counters_of(missing)) == (
        {"overloaded": 4, "restarted": 1},
        {"readings": 5},
    )
    assert in_words(missing | {"off": 0}) == "4 overloaded, 1 restarted"
