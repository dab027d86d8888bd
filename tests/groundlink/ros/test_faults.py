# SPDX-License-Identifier: Apache-2.0
"""Faults become a message of ROS's own types, and come back from it."""

import pytest

from groundlink.episode.fault_messages import Faults, counted, kinds_in
from groundlink.ros.cdr import to_cdr
from groundlink.ros.faults import from_faults
from groundlink.ros.types import STORE
from groundlink.scenario.faults import Bias, Stuck

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
NONE = Faults(2_500_000_000, "rover/imu", 1000, ())
TWO = Faults(
    *(2_600_000_000, "rover/imu", 1040),
    (Stuck(at_s=2.6, for_s=5.0), Bias(value=(0.0, 0.0, 0.25), quantity="angular_velocity")),
)


@pytest.mark.parametrize("faults", [NONE, TWO])
def test_they_come_back_as_they_went(faults: Faults) -> None:
    array = STORE.deserialize_cdr(to_cdr(faults), TYPE)
    assert from_faults(array) == faults


def test_a_person_can_read_them() -> None:
    [status] = STORE.deserialize_cdr(to_cdr(TWO), TYPE).status
    assert (status.name, status.level) == ("rover/imu: faults", 2)
    assert status.message == "stuck, bias"
    [status] = STORE.deserialize_cdr(to_cdr(NONE), TYPE).status
    assert (status.level, status.message) == (0, "none")


def test_other_diagnostics_are_refused() -> None:
    array = STORE.deserialize_cdr(to_cdr(TWO), TYPE)
    array.status[0].values = array.status[0].values[1:]
    with pytest.raises(ValueError, match="no `tick` among its values"):
        from_faults(array)
    array.status = []
    with pytest.raises(ValueError, match="0 statuses"):
        from_faults(array)


def test_counters_tell_them_to_whom_looks_on() -> None:
    counters = {"readings": 5} | counted((Stuck(), Stuck(at_s=1.0), Bias(value=1.0)))
    assert counters == {"readings": 5, "fault_stuck": 2, "fault_bias": 1}
    assert kinds_in(counters) == ["stuck", "bias"]
    assert kinds_in({"readings": 5}) == []
