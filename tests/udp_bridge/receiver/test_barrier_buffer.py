# SPDX-License-Identifier: Apache-2.0
import random
from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import Header, Message, Reassembler
from udp_bridge.receiver.barrier_buffer import (
    HELD_MESSAGES,
    AnnouncedCounts,
    BarrierBuffer,
    in_order,
)
from udp_bridge.wire.lockstep import SentMessages

ODOM, CLOCK, IMU = 36, 8, 2


def message(msg_type: int, topic: str, number: int, stamp: int = 0) -> Message:
    return Message(msg_type, topic, "", stamp, number, b"body")


@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.randoms(use_true_random=False))
def test_reordering_and_duplicates_change_nothing(
    first: int, count: int, rng: random.Random
) -> None:
    sent = [message(ODOM, "/odom", (first + index) % 2**32) for index in range(count)]
    arrivals = sent + rng.sample(sent, rng.randrange(count))
    rng.shuffle(arrivals)
    dropped: list[Message] = []
    buffer = BarrierBuffer(dropped.append)
    for one in arrivals:
        buffer.put(one)
    ranges = (SentMessages(ODOM, "/odom", first, count),)
    assert buffer.missing(ranges) == 0
    assert buffer.take(ranges) == sent
    assert len(dropped) == len(arrivals) - count
    assert buffer.take_all() == []


def test_later_messages_are_held_and_earlier_ones_are_dropped() -> None:
    dropped: list[Message] = []
    buffer = BarrierBuffer(dropped.append)
    for number in (3, 4, 5, 7):
        buffer.put(message(ODOM, "/odom", number))
    buffer.put(message(IMU, "/imu", 0))
    ranges = (SentMessages(ODOM, "/odom", 5, 2),)
    assert buffer.missing(ranges) == 1
    assert [one.seq_number for one in buffer.take(ranges)] == [5]
    assert [one.seq_number for one in dropped] == [3, 4]
    assert {(one.topic, one.seq_number) for one in buffer.take_all()} == {
        ("/odom", 7),
        ("/imu", 0),
    }


class _Counted(dict[int, Message]):
    """A topic's messages; counts reads."""

    reads = 0

    def __contains__(self, number: object) -> bool:
        type(self).reads += 1
        return super().__contains__(number)

    def __iter__(self) -> Iterator[int]:
        for number in super().__iter__():
            type(self).reads += 1
            yield number


def test_ranges_are_counted_without_counting_to_their_end() -> None:
    buffer = BarrierBuffer()
    ranges = tuple(SentMessages(IMU, f"/{index}", 2**32 - 1, 0xFFFF) for index in range(255))
    for sent in ranges:
        buffer._held[sent.msg_type, sent.topic] = _Counted()
        for number in (2**32 - 1, 0, 0xFFFE, 2**31):
            buffer.put(message(IMU, sent.topic, number))
    _Counted.reads = 0
    missing = 255 * (0xFFFF - 2)
    assert buffer.missing(ranges) == missing
    for number in range(1, 100):
        buffer.put(message(IMU, "/7", number))
        assert buffer.missing(ranges) == missing - number
    assert _Counted.reads < 2000
    assert [one.seq_number for one in buffer.take(ranges[:1])] == [2**32 - 1, 0]
    assert buffer.missing(ranges) == missing - 99 + 2


def test_small_bodies_keep_no_large_blocks() -> None:
    buffer, reassembler = BarrierBuffer(), Reassembler()
    for number in range(100):
        for part in range(2):
            header = Header(IMU, number, part, 2, number, 0, "/imu")
            got = reassembler.receive(header.pack() + b"x", "sender", number)
        assert got is not None
        buffer.put(got)
    held = buffer.take_all()
    assert [bytes(one.body) for one in held] == [b"xx"] * 100
    assert sum(memoryview(memoryview(one.body).obj).nbytes for one in held) < 1000


def test_it_holds_no_more_than_its_bound() -> None:
    dropped: list[Message] = []
    buffer = BarrierBuffer(dropped.append)
    for number in range(HELD_MESSAGES + 1):
        buffer.put(message(ODOM, "/odom", number))
    assert [one.seq_number for one in dropped] == [HELD_MESSAGES]


def test_messages_are_published_by_stamp_and_clock_last() -> None:
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


def test_announced_counts_release_later_messages() -> None:
    announced = AnnouncedCounts()
    assert announced.unannounced({(ODOM, "/odom"): 2, (IMU, "/imu"): 0}) == (
        SentMessages(ODOM, "/odom", 0, 2),
    )
    announced.mark_announced({(ODOM, "/odom"): 2})
    assert announced.unannounced({(ODOM, "/odom"): 2}) == ()
    left = {(ODOM, "/odom"): 5, (IMU, "/imu"): 2**32 + 1}
    assert announced.unannounced(left)[1] == SentMessages(ODOM, "/odom", 2, 3)
    announced.mark_announced({(IMU, "/imu"): 2**32 - 1})
    assert announced.unannounced({(IMU, "/imu"): 2**32 + 1}) == (
        SentMessages(IMU, "/imu", 2**32 - 1, 2),
    )
