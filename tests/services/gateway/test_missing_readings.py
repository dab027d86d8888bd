# SPDX-License-Identifier: Apache-2.0
"""Readings that never came to the gateway are counted by topic, and nothing else is."""

import pytest

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Clock
from services.gateway.missing_readings import MissingReadingCounter

SCENARIO = load(SHIPPED / "indoor_lab.yaml")
VEHICLE = SCENARIO.vehicles[0]
STREAMS = {"lidar": "/points", "imu": "/imu", "encoders": "/wheel_encoders"}
DUE = {spec.name: spec.schedule() for spec in VEHICLE.sensors}
SECOND = 1_000_000_000


class Run:
    """A counter of missing readings, and a run whose episodes begin at an epoch."""

    def __init__(self) -> None:
        self.missing_readings = MissingReadingCounter(SCENARIO, "lab")
        self.episode, self.epoch_nanos = 1, 100 * SECOND

    def begins_anew(self, *, epoch_nanos: int) -> None:
        self.episode, self.epoch_nanos = self.episode + 1, epoch_nanos

    def clock(self, seconds: float) -> None:
        nanos = round(seconds * SECOND)
        tick = nanos // 2_500_000
        stamp = self.epoch_nanos + nanos
        self.missing_readings.clock(Clock(stamp, self.epoch_nanos, tick, self.episode))

    def came(self, sensor: str, *readings: int) -> None:
        for reading in readings:
            stamp = self.epoch_nanos + DUE[sensor].nanos(reading)
            self.missing_readings.came(f"groundlink/lab/rover/{sensor}", stamp)

    def not_come(self, topic: str) -> int:
        return self.missing_readings.counters().get(f"not_come_{topic}", 0)


@pytest.fixture
def run() -> Run:
    run = Run()
    run.clock(0)
    return run


@pytest.mark.parametrize("sensor", STREAMS)
@pytest.mark.parametrize(
    ("readings", "not_come"), [([7, 8, 9], 0), ([7, 9], 1), ([7, 10, 11, 15], 5), ([12], 0)]
)
def test_readings_missing_between_two_are_counted(
    run: Run, sensor: str, readings: list[int], not_come: int
) -> None:
    run.came(sensor, *readings)
    run.clock(2)
    assert run.not_come(STREAMS[sensor]) == not_come


def test_readings_ahead_of_the_clock_wait_for_it(run: Run) -> None:
    run.came("encoders", 5, 50, 51)  # 50 a second
    run.clock(0.1)
    assert run.not_come("/wheel_encoders") == 0
    run.clock(1)
    assert run.not_come("/wheel_encoders") == 44


@pytest.mark.parametrize("epoch_nanos", [100 * SECOND, 140 * SECOND], ids=["the same", "later"])
def test_an_episode_is_counted_to_its_end_and_the_next_one_from_its_start(
    run: Run, epoch_nanos: int
) -> None:
    """One epoch is that of a run with its own time, the other one the wall clock's."""
    run.came("encoders", *range(50))
    run.clock(2)
    run.came("encoders", 95)
    run.begins_anew(epoch_nanos=epoch_nanos)
    run.came("encoders", 2)
    run.clock(0.1)
    # To the last clock 101 were due, of which the last one may have been under way.
    assert run.not_come("/wheel_encoders") == 45 + 4
    run.clock(0.2)
    assert run.not_come("/wheel_encoders") == 45 + 4 + 2
    run.came("encoders", 3, 5)
    run.clock(0.3)
    assert run.not_come("/wheel_encoders") == 45 + 4 + 3


def test_readings_that_arrive_after_their_episode_are_not_missing(run: Run) -> None:
    run.came("encoders", *range(50))
    run.clock(2)
    run.begins_anew(epoch_nanos=140 * SECOND)
    run.clock(0)
    assert run.not_come("/wheel_encoders") == 50
    run.begins_anew(epoch_nanos=100 * SECOND)
    run.came("encoders", 50, 52, 52, 3000)
    run.begins_anew(epoch_nanos=140 * SECOND)
    run.episode = 2
    run.came("encoders", 0)
    run.clock(0.1)
    assert run.not_come("/wheel_encoders") == 48


def test_a_stream_that_never_came_is_not_missed(run: Run) -> None:
    run.clock(5)
    run.begins_anew(epoch_nanos=140 * SECOND)
    run.clock(0)
    run.clock(5)
    run.came("imu", 1000)
    run.clock(6)
    assert run.missing_readings.counters() == {}


def test_a_successor_goes_on_from_where_the_last_one_was(run: Run) -> None:
    run.came("encoders", 7, 9)
    run.clock(1)
    run.came("encoders", 10)
    after = Run()
    after.came("encoders", 20, 21)
    after.clock(1)
    after.missing_readings.remember(*run.missing_readings.memory())
    after.clock(1.1)
    assert after.not_come("/wheel_encoders") == 1 + 9


def test_what_is_no_reading_is_passed_over(run: Run) -> None:
    run.missing_readings.came("groundlink/lab/clock", run.epoch_nanos)
    run.missing_readings.came("groundlink/lab/clock", run.epoch_nanos + 10 * SECOND)
    run.clock(11)
    assert run.missing_readings.counters() == {}
