# SPDX-License-Identifier: Apache-2.0
"""Gaps become a message of ROS's own types, and come back from it."""

from collections import Counter

import pytest

from groundlink.messages.missing_readings import (
    Cause,
    MissingReadings,
    MissingSpan,
    counters_of,
    in_words,
    parted,
)
from groundlink.ros.cdr import to_cdr
from groundlink.ros.missing_readings import from_missing_readings
from groundlink.ros.types import STORE

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
THREE = MissingReadings(
    *(2_600_000_000, "rover/camera"),
    (
        MissingSpan("overloaded", 0, 66_666_666, 3, ("", "camera_info")),
        MissingSpan("drop", 100_000_000, 100_000_000, 1, ("",)),
        MissingSpan("overloaded", 200_000_000, 200_000_000, 1, ("", "camera_info")),
    ),
)


def test_they_come_back_as_they_went() -> None:
    array = STORE.deserialize_cdr(to_cdr(THREE), TYPE)
    assert from_missing_readings(array) == THREE


def test_a_person_can_read_them() -> None:
    [status] = STORE.deserialize_cdr(to_cdr(THREE), TYPE).status
    assert (status.name, status.level) == ("rover/camera: gaps", 1)
    assert status.message == "4 overloaded, 1 drop"


def test_other_diagnostics_are_refused() -> None:
    array = STORE.deserialize_cdr(to_cdr(THREE), TYPE)
    array.status[0].values[0].value = "{}"
    with pytest.raises(ValueError, match="cause"):
        from_missing_readings(array)


def test_counters_tell_them_to_whom_looks_on() -> None:
    missing: Counter[Cause] = Counter({"overloaded": 4, "restarted": 1})
    assert parted({"readings": 5} | counters_of(missing)) == (
        {"overloaded": 4, "restarted": 1},
        {"readings": 5},
    )
    assert in_words(missing | {"off": 0}) == "4 overloaded, 1 restarted"
