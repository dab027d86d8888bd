# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from itertools import pairwise

from groundlink.core.backoff import MOST_QUIET_SECONDS, QUIET_SECONDS, Backoff


def asked_at(quiet: Backoff, seconds: int) -> list[int]:
    return [now for now in range(seconds) if quiet.is_too_long(now)]


def test_it_asks_ever_less_often_while_nothing_comes() -> None:
    asked = asked_at(Backoff(-1.0), 1000)
    waits = [later - now for now, later in pairwise(asked)]
    assert asked[0] == QUIET_SECONDS
    assert waits[:3] == [5, 9, 17]
    assert waits[-1] == MOST_QUIET_SECONDS + 1


def test_what_comes_begins_the_quiet_anew() -> None:
    quiet = Backoff(0.0)
    assert len(asked_at(quiet, 100)) > 3
    quiet.heard(100.0)
    assert not quiet.is_too_long(100.0 + QUIET_SECONDS)
    assert quiet.is_too_long(100.1 + QUIET_SECONDS)
