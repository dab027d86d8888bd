# SPDX-License-Identifier: Apache-2.0
"""Processes of a pipeline pass messages on, and end together."""

import time
from pathlib import Path

import pytest

from groundlink.bus.pipe import PipedMessage
from groundlink.core.errors import RequirementError, UserError
from groundlink.loader import load
from groundlink.monitor.pipeline import pipeline, repeated_sensors, write_output

START = "from groundlink.bus.pipe import *; source, out = standard_streams(); bus = PipeBus(out); "
ENDLESS = START + "print('noise')\nwhile True: bus.write('key', bytes(1000))"
COUNT = START + "[bus.write('key', bytes([i])) for i in range(3)]; bus.close()"
PASS_ON = START + "[bus.write(*each) for each in read_piped(source)]; bus.close()"


def test_messages_pass_all_processes() -> None:
    with pipeline([["-c", COUNT], ["-c", PASS_ON], ["-c", PASS_ON]]) as messages:
        assert [*messages] == [PipedMessage("key", bytes([i])) for i in range(3)]


def test_the_first_process_reads_a_file(tmp_path: Path) -> None:
    file = tmp_path / "messages"
    with file.open("wb") as opened:
        write_output(["-c", COUNT], opened)
    with file.open("rb") as source, pipeline([["-c", PASS_ON]], source) as messages:
        assert len([*messages]) == 3


def test_processes_end_with_the_block() -> None:
    with pipeline([["-c", ENDLESS], ["-c", PASS_ON]]) as messages:
        assert next(iter(messages)).key == "key"
        begin = time.monotonic()
    assert time.monotonic() - begin < 60


@pytest.mark.parametrize(("code", "error"), [(2, UserError), (3, RequirementError)])
@pytest.mark.parametrize("place", [0, 1])
def test_a_process_that_fails_is_named(code: int, error: type[UserError], place: int) -> None:
    commands = [["-c", ENDLESS], ["-c", PASS_ON]]
    # The words after the program are its arguments.
    commands[place] = ["-c", f"raise SystemExit({code})", "-m", "service"]
    with pipeline(commands) as messages, pytest.raises(error, match="service failed"):
        list(messages)


def test_a_sensor_that_sees_the_world_has_a_process_of_its_own() -> None:
    scenario = load("indoor_lab")
    commands = repeated_sensors(scenario, scenario.sensor_names(), Path("run.journal"))
    named = [[w for w in words if w.startswith("rover/")] for words in commands]
    assert named == [["rover/lidar"], ["rover/camera"], ["rover/imu", "rover/encoders"]]
