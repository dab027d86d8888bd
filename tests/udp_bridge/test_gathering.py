# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import Message
from udp_bridge.gathering import HELD_MESSAGES, Gathering, Tally, in_order
from udp_bridge.lockstep import Sent

ODOM, CLOCK, IMU = 36, 8, 2


def message(msg_type: int, topic: str, number: int, stamp: int = 0) -> Message:
    return Message(msg_type, topic, "", stamp, number, b"body")


@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.randoms(use_true_random=False))
def test_any_order_and_any_copies_give_the_same(first: int, count: int, rng: random.Random) -> None:
    sent = [message(ODOM, "/odom", (first + index) % 2**32) for index in range(count)]
    come = sent + rng.sample(sent, rng.randrange(count))
    rng.shuffle(come)
    dropped: list[Message] = []
    gathering = Gathering(dropped.append)
    for one in come:
        gathering.put(one)
    told = (Sent(ODOM, "/odom", first, count),)
    assert gathering.missing(told) == 0
    assert gathering.take(told) == sent
    assert len(dropped) == len(come) - count
    assert gathering.take_all() == []


def test_what_is_told_later_is_held_and_what_nobody_tells_of_any_more_goes() -> None:
    dropped: list[Message] = []
    gathering = Gathering(dropped.append)
    for number in (3, 4, 5, 7):
        gathering.put(message(ODOM, "/odom", number))
    gathering.put(message(IMU, "/imu", 0))
    told = (Sent(ODOM, "/odom", 5, 2),)
    assert gathering.missing(told) == 1
    assert [one.seq_number for one in gathering.take(told)] == [5]
    assert [one.seq_number for one in dropped] == [3, 4]
    assert {(one.topic, one.seq_number) for one in gathering.take_all()} == {
        ("/odom", 7),
        ("/imu", 0),
    }


def test_it_holds_no_more_than_its_bound() -> None:
    dropped: list[Message] = []
    gathering = Gathering(dropped.append)
    for number in range(HELD_MESSAGES + 1):
        gathering.put(message(ODOM, "/odom", number))
    assert [one.seq_number for one in dropped] == [HELD_MESSAGES]


def test_the_order_of_publishing_is_that_of_stamps_and_clock_comes_last() -> None:
    wanted = [
        message(IMU, "/imu", 9, 1),
        message(CLOCK, "/clock", 0, 1),
        message(IMU, "/imu", 7, 2),
        message(IMU, "/imu", 8, 2),
        message(ODOM, "/a", 3, 2),
        message(ODOM, "/odom", 1, 2),
        message(CLOCK, "/clock", 1, 2),
    ]
    assert in_order(reversed(wanted)) == wanted


def test_a_tally_tells_what_left_since_the_last_time() -> None:
    tally = Tally()
    assert tally.since({(ODOM, "/odom"): 2, (IMU, "/imu"): 0}) == (Sent(ODOM, "/odom", 0, 2),)
    tally.tell({(ODOM, "/odom"): 2})
    assert tally.since({(ODOM, "/odom"): 2}) == ()
    left = {(ODOM, "/odom"): 5, (IMU, "/imu"): 2**32 + 1}
    assert tally.since(left)[1] == Sent(ODOM, "/odom", 2, 3)
    tally.tell({(IMU, "/imu"): 2**32 - 1})
    assert tally.since({(IMU, "/imu"): 2**32 + 1}) == (Sent(IMU, "/imu", 2**32 - 1, 2),)
