# SPDX-License-Identifier: Apache-2.0
"""The first difference of two runs: topic, time, number, field and both values."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.loader import load
from groundlink.messages.base import BusMessage, Clock, Command, Imu
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.recording.run_difference import RunDifference, first_run_difference
from groundlink.ros.cdr import CODECS, to_cdr

EPOCH = 1_000 * NANOS
SCENARIO = load("indoor_lab")
Rows = Sequence[tuple[float, str, float]]
"""Time in s, topic, value."""


def message(nanos: int, topic: str, value: float) -> BusMessage:
    match topic:
        case "/cmd_vel":
            return Command(nanos, (value, 0.0, 0.0), (0.0, 0.0, 0.0))
        case "/clock":
            return Clock(nanos, EPOCH, (nanos - EPOCH) // TICK_NANOS, 1)
        case _:
            upright, turn = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, value)
            return Imu(nanos, "imu_link", upright, turn, (0.0, 0.0, 9.81), 0.0, 0.0, 0.0)


def recording(path: Path, rows: Rows, end_s: float | None = 10.0) -> Path:
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(SCENARIO, "lab", EPOCH)))
    for seconds, topic, value in [(0.0, "/clock", 0.0), *rows]:
        nanos = EPOCH + round(seconds * NANOS)
        made = message(nanos, topic, value)
        form = CODECS[type(made)]
        file.topic(topic, form.ros_type).write(nanos, to_cdr(made))
    if end_s is not None:
        file.end(EPOCH + round(end_s * NANOS))
    file.commit({})
    file.close()
    return path


IMU: Rows = [(second, "/imu", 0.0) for second in (1.0, 2.0, 3.0)]
Z = "angular_velocity.z"


@pytest.mark.parametrize(
    ("good", "bad", "expected"),
    [
        (IMU, IMU, None),
        (IMU, [*IMU[:2], (3.0, "/imu", 0.5)], RunDifference("/imu", 3.0, 3, Z, "0.0", "0.5")),
        (IMU, IMU[:2], RunDifference("/imu", 3.0, 3, "", "a message", "no message")),
        (IMU[1:], IMU, RunDifference("/imu", 1.0, 1, "", "no message", "a message")),
        (
            [*IMU, (3.0, "/cmd_vel", 0.1)],
            [*IMU[:2], (3.0, "/imu", 0.5), (3.0, "/cmd_vel", 0.2)],
            RunDifference("/cmd_vel", 3.0, 1, "linear.x", "0.1", "0.2"),
        ),
        (
            [*IMU, (3.0, "/imu2", 0.0)],
            IMU,
            RunDifference("/imu2", 3.0, 1, "", "a message", "no message"),
        ),
        (IMU, [*IMU, (11.0, "/imu", 0.0)], None),
        (IMU, [*IMU, (3.5, "/faults/rover/imu", 0.0), (3.5, "/tf", 0.0)], None),
    ],
)
def test_first_difference(
    good: Rows, bad: Rows, expected: RunDifference | None, tmp_path: Path
) -> None:
    with (
        Recording(recording(tmp_path / "good.mcap", good)) as first,
        Recording(recording(tmp_path / "bad.mcap", bad)) as second,
    ):
        assert first_run_difference(first, second) == expected


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ((3.5, "/imu", 0.0), None),
        ((2.5, "/imu", 0.5), RunDifference("/imu", 2.5, 3, Z, "0.5", "0.0")),
    ],
)
def test_last_messages_of_a_recording_that_was_ended_early_may_be_missing(
    more: tuple[float, str, float], expected: RunDifference | None, tmp_path: Path
) -> None:
    shorter = [*IMU[:2], (2.5, "/imu", 0.0)]
    longer = [*shorter[: 2 if expected else 3], more]
    with (
        Recording(recording(tmp_path / "good.mcap", longer)) as first,
        Recording(recording(tmp_path / "bad.mcap", shorter, end_s=None)) as second,
    ):
        assert first_run_difference(first, second) == expected
