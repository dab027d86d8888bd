# SPDX-License-Identifier: Apache-2.0
"""Each point has one holder at a time, and comes back if its holder lost it."""

from groundlink.search.point_journal import key
from groundlink.search.point_leases import EVALUATED_HERE, LEASE_SECONDS, PointLeases


def leases(count: int) -> PointLeases:
    made = PointLeases()
    for number in range(1, count + 1):
        made.add("search", number, {"seed": number})
    return made


def taken(found: PointLeases, worker: str, most: int) -> list[int]:
    return [point.number for point in found.take(worker, most).values()]


def name(number: int) -> str:
    return key({"seed": number})


def test_points_are_taken_once_and_in_order() -> None:
    found = leases(5)
    assert taken(found, EVALUATED_HERE, 1) == [1]
    assert taken(found, "one", 2) == [2, 3]
    assert taken(found, "two", 9) == [4, 5]
    assert taken(found, "one", 1) == []
    assert taken(found, "one", -1) == []


def test_first_outcome_counts() -> None:
    found = leases(2)
    found.take("one", 1)
    point = found.finish(name(1))
    assert point is not None
    assert (point.stage, point.number, point.values) == ("search", 1, {"seed": 1})
    assert found.finish(name(1)) is None
    assert taken(found, "one", 9) == [2]


def test_point_that_its_worker_does_not_name_comes_back_first() -> None:
    found = leases(4)
    assert found.heard("one", [], 0.0), "a new worker"
    assert taken(found, "one", 2) == [1, 2]
    assert not found.heard("one", [name(2)], 1.0)
    assert taken(found, "two", 2) == [1, 3]


def test_point_of_a_silent_worker_comes_back() -> None:
    found = leases(3)
    for worker in ("one", "two"):
        found.heard(worker, [], 0.0)
        found.take(worker, 1)
    found.take(EVALUATED_HERE, 1)
    found.heard("two", [name(2)], LEASE_SECONDS)
    assert found.silent(LEASE_SECONDS) == []
    assert found.silent(LEASE_SECONDS + 1) == ["one"]
    assert taken(found, "two", 9) == [1]
    assert found.heard("one", [name(1)], LEASE_SECONDS + 1)
    assert found.finish(name(1)) is not None, "it was not dead: its outcome is as good"


def test_point_that_a_worker_brings_from_before_a_restart_is_its_own() -> None:
    found = leases(2)
    found.heard("one", [name(1), name(7)], 0.0)
    assert taken(found, "two", 9) == [2]
