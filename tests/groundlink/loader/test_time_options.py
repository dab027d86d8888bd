# SPDX-License-Identifier: Apache-2.0
"""A scenario in another time than its file says."""

import argparse

import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader.time_options import add_arguments, forwarded, with_time_options
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Time


def options(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)


WORDS = ("--mode", "lockstep", "--factor", "0.5", "--lockstep", "ros", "--overload", "skip")


def test_what_is_given_is_taken_and_the_rest_is_left(lab: Scenario) -> None:
    long_deadline = replace(lab, time=Time(deadline_s=9.0))
    assert with_time_options(long_deadline, options()) == long_deadline
    expected = Time("lockstep", "ros", 0.5, "skip", deadline_s=9.0)
    assert with_time_options(long_deadline, options(*WORDS)).time == expected


def test_it_is_handed_on_as_it_was_given() -> None:
    assert forwarded(options()) == []
    assert forwarded(options(*WORDS)) == list(WORDS)


@pytest.mark.parametrize(
    ("words", "time", "told"),
    [
        (("--factor", "0"), Time(), "--factor 0: expected more than 0"),
        (("--mode", "realtime"), Time(mode="fast", lockstep="ros"), "`lockstep: ros` waits for"),
        (("--mode", "fast"), Time(window_ticks=1023), "`time.window_ticks`: 1023 and"),
    ],
)
def test_what_cannot_be_is_one_line(
    lab: Scenario, words: tuple[str, ...], time: Time, told: str
) -> None:
    with pytest.raises(UserError, match=told):
        with_time_options(replace(lab, time=time), options(*words))
