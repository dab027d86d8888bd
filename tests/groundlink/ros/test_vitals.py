# SPDX-License-Identifier: Apache-2.0
"""Vitals become a message of ROS's own types, and come back from it."""

import pytest

from groundlink.messages.vitals import BatteryState, Contact, Vitals
from groundlink.ros.cdr import to_cdr
from groundlink.ros.types import STORE
from groundlink.ros.vitals import from_vitals

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
CALM = Vitals(2_500_000_000, "rover", 1000, 35.114, 4.25, ())
HIT = Vitals(
    *(2_600_000_000, "rover", 1040, 36.5, 4.25),
    (Contact("table_3_leg_1", 9681.88, 1036, 4), Contact("wall_east_whole", 0.5, 1020, 1)),
    BatteryState(0.5, 24.5, 3.25),
)


@pytest.mark.parametrize("vitals", [CALM, HIT])
def test_they_come_back_as_they_went(vitals: Vitals) -> None:
    array = STORE.deserialize_cdr(to_cdr(vitals), TYPE)
    assert from_vitals(array) == vitals


def test_a_person_can_read_them() -> None:
    [status] = STORE.deserialize_cdr(to_cdr(HIT), TYPE).status
    assert status.name == "rover: vitals"
    assert status.level == 1
    assert status.message == "touches table_3_leg_1, wall_east_whole"
    [status] = STORE.deserialize_cdr(to_cdr(CALM), TYPE).status
    assert (status.level, status.message) == (0, "touches nothing")


def test_other_diagnostics_are_refused() -> None:
    array = STORE.deserialize_cdr(to_cdr(HIT), TYPE)
    array.status[0].values = array.status[0].values[1:]
    with pytest.raises(ValueError, match="no 'tick' among its values"):
        from_vitals(array)
    array.status = []
    with pytest.raises(ValueError, match="0 statuses"):
        from_vitals(array)
