# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from groundlink.messages.base import Ack
from groundlink.scenario.route import (
    COMMAND_AHEAD_TICKS,
    DRIVER_PERIOD_TICKS,
    DRIVER_WINDOW_TICKS,
)
from services.physics.run.participants import Parties, Promises, barriers, window

LIFE = 7


@pytest.fixture
def parties() -> Parties:
    """Return what a run in lockstep waits for."""
    demands = dict.fromkeys(("rover/imu", "rover/lidar"), window(100))
    return Parties(demands, needed=demands, of_others=window(50), life=LIFE)


@pytest.fixture
def present() -> Parties:
    """Return what a run in real time waits for."""
    return Parties(dict.fromkeys(("rover/imu", "rover/lidar"), window(100)), life=LIFE)


def ack(parties: Parties, process: str, tick: int, life: int = LIFE) -> None:
    parties.acknowledged(process, Ack(life, tick, tick))


def test_nothing_moves_before_all_that_are_needed_have_joined(parties: Parties) -> None:
    assert parties.missing(0) == ["rover/imu", "rover/lidar"]
    ack(parties, "rover/imu", -1)
    assert parties.missing(1) == ["rover/lidar"]
    ack(parties, "rover/lidar", -1)
    assert parties.missing(1) == []
    assert not parties.has_followed("rover/imu")
    ack(parties, "rover/imu", 0)
    assert parties.has_followed("rover/imu")


def test_physics_is_at_most_a_window_ahead(parties: Parties) -> None:
    ack(parties, "rover/imu", 1000)
    ack(parties, "rover/lidar", 50)
    assert parties.missing(150) == []
    assert parties.missing(151) == ["rover/lidar"]
    ack(parties, "rover/lidar", 51)
    assert parties.missing(151) == []


def test_others_are_waited_for_while_they_are_there(parties: Parties) -> None:
    ack(parties, "rover/imu", 1000)
    ack(parties, "rover/lidar", 1000)
    ack(parties, "viewer", 10)
    assert parties.missing(60) == []
    assert parties.missing(61) == ["viewer"]
    parties.left("viewer")
    assert parties.missing(61) == []


def test_who_is_needed_is_waited_for_when_it_has_left(parties: Parties) -> None:
    ack(parties, "rover/imu", 1000)
    ack(parties, "rover/lidar", 10)
    parties.left("rover/lidar")
    assert parties.missing(500) == ["rover/lidar"]


def test_words_of_another_life_do_not_count(parties: Parties) -> None:
    ack(parties, "rover/imu", 1000, life=LIFE - 1)
    assert "rover/imu" in parties.missing(1)


def test_in_real_time_those_are_waited_for_that_are_there_and_matter(present: Parties) -> None:
    assert present.missing(10**6) == []
    ack(present, "gateway", 5)
    ack(present, "rover/imu", 5)
    assert present.missing(105) == []
    assert present.missing(106) == ["rover/imu"]
    present.left("rover/imu")
    assert present.missing(106) == []


def test_who_is_given_up_counts_again_with_its_next_word(
    parties: Parties, present: Parties
) -> None:
    for some in (parties, present):
        ack(some, "rover/imu", 1000)
        ack(some, "rover/lidar", 5)
        some.give_up("rover/lidar")
        assert some.missing(500) == []
        assert some.given_up == {"rover/lidar"}
        ack(some, "rover/lidar", 6)
        assert some.given_up == set()
        assert some.missing(500) == ["rover/lidar"]
    present.give_up("rover/lidar")
    present.left("rover/lidar")
    assert present.given_up == set(), "who has left is not silent"
    parties.give_up("rover/lidar")
    parties.left("rover/lidar")
    assert parties.missing(500) == [], "it was given up, and is still needed"
    assert parties.given_up == {"rover/lidar"}


def test_who_is_not_wanted_any_more_is_not_waited_for(parties: Parties) -> None:
    for name in ("rover/imu", "rover/lidar", "viewer"):
        ack(parties, name, 0)
    parties.give_up("rover/lidar")
    parties.only(("rover/imu",))
    assert parties.missing(500) == ["rover/imu", "viewer"]
    assert parties.given_up == set()


def test_a_step_in_which_a_drivers_command_acts_waits_for_that_command() -> None:
    demands = {"rover/driver": window(DRIVER_WINDOW_TICKS)}
    parties = Parties(demands, needed=demands, life=LIFE)
    assert parties.missing(1)
    for answered in range(-DRIVER_PERIOD_TICKS, 80, DRIVER_PERIOD_TICKS):
        ack(parties, "rover/driver", answered)
        due = answered + DRIVER_PERIOD_TICKS
        assert not parties.missing(due), "it never sees the state to answer"
        acts = due + COMMAND_AHEAD_TICKS  # the tick that the command for `due` is stamped with
        assert not parties.missing(acts)
        assert parties.missing(acts + 1)


def test_a_step_after_a_barrier_waits_for_the_word_on_that_barrier() -> None:
    """What was commanded by the barrier acts in the step after it, and never in another one."""
    parties = Parties({"gateway": barriers(4)}, needed=("gateway",), life=LIFE)
    ack(parties, "gateway", -1)
    assert not parties.missing(0), "the first state has to be told"
    for barrier in range(0, 40, 4):
        assert parties.missing(barrier + 1)
        ack(parties, "gateway", barrier)
        assert not any(parties.missing(tick) for tick in range(barrier + 1, barrier + 5))


def test_a_word_counts_when_the_commands_that_it_speaks_of_are_here() -> None:
    promises = Promises()
    first = Ack(LIFE, -8, -1)
    promises.given("rover/driver", first)
    assert list(promises.kept()) == [("rover/driver", first)]
    word = Ack(LIFE, 8, 8, commanded={"rover": 16, "second": 12})
    promises.given("gateway", word)
    promises.given("rover/imu", Ack(LIFE, 50, 40))
    assert [name for name, _ in promises.kept()] == ["rover/imu"]
    promises.commanded("rover", 16)
    promises.commanded("second", 8)
    assert list(promises.kept()) == []
    promises.commanded("second", 12)
    promises.commanded("second", 11)
    assert list(promises.kept()) == [("gateway", word)]
    assert list(promises.kept()) == []
