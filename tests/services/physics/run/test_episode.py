# SPDX-License-Identifier: Apache-2.0
"""Whose word counts in one life of a run."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.load import SHIPPED
from groundlink.messages.base import Ack, decode
from groundlink.scenario.schema import Time
from services.physics.run.episode import Life
from services.physics.run.publishers import unheard

LIFE = 5
LAB = load(SHIPPED / "indoor_lab.yaml")


@pytest.fixture(params=["fast", "realtime"])
def life(request: pytest.FixtureRequest) -> Iterator[Life]:
    scenario = replace(LAB, time=Time(mode=request.param))
    life = Life(scenario, "run", unheard(), others=(), wall_nanos=LIFE)
    life.begin(LIFE, 0.0)
    yield life
    life.end()


def heard(life: Life, process: str) -> int:
    """Return how far a process is, as it would hear itself."""
    return decode(life.missed_by(process)[0], Ack).tick


def says(life: Life, process: str, tick: int) -> None:
    life.acknowledged(process, Ack(LIFE, tick, tick))
    life.settle()


def test_who_was_cut_off_is_heard_again_when_it_has_asked_what_it_missed(life: Life) -> None:
    says(life, "rover/imu", 3)
    life.left("rover/imu")
    says(life, "rover/imu", 7)
    waits = life.scenario.time.mode == "fast"
    assert heard(life, "rover/imu") == (3 if waits else 7), "what it said in between may be lost"
    says(life, "rover/imu", 8)
    assert heard(life, "rover/imu") == 8


def test_others_than_sensors_and_drivers_have_nothing_to_repeat(life: Life) -> None:
    life.left("gateway")
    says(life, "gateway", 7)
    assert life.journal().acks["gateway"].tick == 7


@pytest.mark.parametrize(
    ("time", "begins_nanos"),
    [
        (Time(), 7),
        (Time("fast"), 10**18),
        (Time("lockstep"), 10**18),
        (Time("fast", epoch="wall"), LIFE),
        (Time(epoch="fixed"), 10**18),
        (Time(epoch="zero"), 0),
        (Time("fast", epoch="zero"), 0),
    ],
)
def test_a_run_that_does_not_follow_the_wall_clock_begins_at_the_same_stamp(
    time: Time, begins_nanos: int
) -> None:
    life = Life(replace(LAB, time=time), "run", unheard(), others=(), wall_nanos=LIFE)
    life.begin(7, 0.0)
    assert life.epoch_nanos == begins_nanos
    life.end()
