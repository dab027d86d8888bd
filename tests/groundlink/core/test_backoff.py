# SPDX-License-Identifier: Apache-2.0
from itertools import pairwise

from groundlink.core.backoff import FIRST_SECONDS, MAX_SECONDS, Backoff


def asked_at(backoff: Backoff, seconds: int) -> list[int]:
    return [now for now in range(seconds) if backoff.is_due(now)]


def test_it_asks_ever_less_often_while_nothing_comes() -> None:
    asked = asked_at(Backoff(-1.0), 1000)
    waits = [later - now for now, later in pairwise(asked)]
    assert asked[0] == FIRST_SECONDS
    assert waits[:3] == [5, 9, 17]
    assert waits[-1] == MAX_SECONDS + 1


def test_each_arrival_resets_the_backoff() -> None:
    backoff = Backoff(0.0)
    assert len(asked_at(backoff, 100)) > 3
    backoff.reset(100.0)
    assert not backoff.is_due(100.0 + FIRST_SECONDS)
    assert backoff.is_due(100.1 + FIRST_SECONDS)
