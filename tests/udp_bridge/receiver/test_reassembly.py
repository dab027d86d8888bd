# SPDX-License-Identifier: Apache-2.0
"""The receiving rules, each geometry by its name. Times are seconds here, for readability."""

from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from udp_bridge import Header, Limits, Message, Reassembler
from udp_bridge.receiver.assembly import OVERHEAD_BYTES
from udp_bridge.wire.types import STAMP_ORDERED

PART = 100
POINTS = Header(1, 10, 0, 4, 1000, 0, "/points", "lidar")
IMU = Header(2, 10, 0, 1, 1000, 0, "/imu", "imu")


class Receiver:
    """A reassembler that is told of parts and reads at bodies, with one sender by default."""

    def __init__(self, **limits: object) -> None:
        self.reassembler = Reassembler(Limits(**limits))  # type: ignore[arg-type]
        self.now_s = 0.0

    def part(
        self, header: Header, number: int = 0, size: int = PART, sender: object = "a"
    ) -> Message | None:
        body = bytes([header.seq_number % 256, number]) * (size // 2) + b"x" * (size % 2)
        datagram = bytearray(header._replace(part_number=number).pack() + body)
        now_nanos = int(self.now_s * 1e9)
        message = self.reassembler.receive(datagram, sender, now_nanos)
        datagram[:] = bytes(len(datagram))  # the caller may reuse its buffer
        return message

    def parts(self, header: Header, numbers: Iterable[int]) -> list[Message]:
        received = [self.part(header, number) for number in numbers]
        return [message for message in received if message is not None]

    def seqs(self, *headers: Header) -> list[int]:
        received = [self.part(header) for header in headers]
        return [message.seq_number for message in received if message is not None]

    @property
    def counts(self) -> dict[str, object]:
        counts = self.reassembler.counters.as_dict()
        return {name: count for name, count in counts.items() if count}


@pytest.fixture
def receiver() -> Receiver:
    return Receiver()


def imu(seq_number: int, stamp_s: float = 1000.0) -> Header:
    sec, nsec = divmod(int(stamp_s * 1e9), 10**9)
    return IMU._replace(seq_number=seq_number, time_sec=sec, time_nsec=nsec)


def cloud(seq_number: int, stamp_s: int = 1000, parts: int = 4) -> Header:
    return POINTS._replace(seq_number=seq_number, time_sec=stamp_s, parts_max=parts)


# One message.


@pytest.mark.parametrize(
    "order",
    [(0, 1, 2, 3), (3, 2, 1, 0), (3, 0, 1, 2), (1, 3, 0, 2), (2, 0, 3, 1), (0, 1, 3, 2)],
)
def test_parts_in_any_order(order: tuple[int, ...], receiver: Receiver) -> None:
    (message,) = receiver.parts(POINTS, order)
    assert message.body == b"".join(bytes([10, number]) * 50 for number in range(4))
    assert message._replace(body=b"") == Message(1, "/points", "lidar", 10**12, 10, b"", 4)
    assert receiver.counts == {"messages": 1}


def test_the_last_part_may_be_shorter() -> None:
    for order in ((0, 1), (1, 0)):
        receiver = Receiver()
        header = cloud(1, parts=2)
        results = [receiver.part(header, number, PART if number == 0 else 7) for number in order]
        assert results[0] is None
        assert results[1] is not None
        assert len(results[1].body) == PART + 7


def test_bodies_are_read_only_and_their_own(receiver: Receiver) -> None:
    single = receiver.part(IMU)
    (joined,) = receiver.parts(POINTS, range(4))
    for message in (single, joined):
        assert message is not None
        assert isinstance(message.body, memoryview)
        assert message.body.readonly
        assert message.body[0] == 10  # the datagram's buffer was overwritten after receiving


def test_a_single_empty_part_is_a_message() -> None:
    message = Receiver().part(IMU, size=0)
    assert message is not None
    assert message.body == b""


# Parts that don't fit.


def test_a_middle_part_of_another_size_is_refused() -> None:
    for size in (PART - 1, PART + 1):
        receiver = Receiver()
        receiver.part(POINTS, 0)
        receiver.part(POINTS, 1, size)
        assert receiver.counts == {"refused": {"part_size": 1}}
        assert len(receiver.parts(POINTS, (1, 2, 3))) == 1


def test_a_last_part_that_is_larger_is_refused(receiver: Receiver) -> None:
    receiver.part(POINTS, 0)
    receiver.part(POINTS, 3, PART + 1)
    assert receiver.counts == {"refused": {"part_size": 1}}
    assert len(receiver.parts(POINTS, (1, 2, 3))) == 1


def test_an_early_last_part_that_is_too_large_is_refused_later(receiver: Receiver) -> None:
    receiver.part(POINTS, 3, PART + 1)
    assert receiver.counts == {}
    receiver.part(POINTS, 1)
    assert receiver.counts == {"refused": {"part_size": 1}}
    (message,) = receiver.parts(POINTS, (0, 2, 3))
    assert len(message.body) == 4 * PART
    assert receiver.reassembler.memory_bytes == 0


def test_an_empty_part_of_several_is_refused_and_opens_nothing(receiver: Receiver) -> None:
    receiver.part(POINTS, 3, 0)
    receiver.part(POINTS, 0, 0)
    receiver.reassembler.give_up_all()
    assert receiver.counts == {"refused": {"part_size": 2}}


def test_a_part_that_disagrees_is_refused(receiver: Receiver) -> None:
    receiver.part(POINTS, 0)
    receiver.part(POINTS._replace(parts_max=5), 1)
    receiver.part(POINTS._replace(parts_max=1), 0)
    receiver.part(POINTS._replace(link="other"), 1)
    assert receiver.counts == {"refused": {"parts_max": 2, "link": 1}}
    assert len(receiver.parts(POINTS, (1, 2, 3))) == 1


def test_parts_of_another_message_do_not_conflict(receiver: Receiver) -> None:
    others = [
        POINTS._replace(seq_number=11),
        POINTS._replace(time_sec=1001),
        POINTS._replace(time_nsec=1),
        POINTS._replace(topic="/other"),
        POINTS._replace(msg_type=33),
    ]
    for header in others:
        receiver.part(header, 0)
    receiver.part(POINTS, 0, sender="b")
    (message,) = receiver.parts(POINTS, range(4))
    assert message.seq_number == 10
    assert "refused" not in receiver.counts


# Twice.


def test_the_first_copy_of_a_part_counts(receiver: Receiver) -> None:
    receiver.parts(POINTS, (0, 0, 3, 3, 1, 1))
    receiver.part(POINTS, 1, PART + 3)  # a copy, whatever its size
    assert receiver.counts == {"duplicates": 4}
    assert len(receiver.parts(POINTS, (2,))) == 1


def test_parts_of_a_finished_message_are_duplicates(receiver: Receiver) -> None:
    receiver.parts(POINTS, range(4))
    receiver.parts(POINTS, range(4))
    receiver.seqs(imu(5), imu(5), imu(5))
    assert receiver.counts == {"messages": 2, "duplicates": 6}


def test_the_last_64_finished_messages_are_remembered(receiver: Receiver) -> None:
    receiver.seqs(*(imu(seq) for seq in range(65)))
    receiver.part(imu(1))
    assert receiver.counts == {"messages": 65, "duplicates": 1}
    receiver.part(imu(0))  # no longer remembered, and so it is behind
    assert receiver.counts == {"messages": 65, "duplicates": 1, "late": 1}


# Order.

Rows = list[tuple[float, ...]]
ORDER: dict[str, tuple[int, Rows, list[int], int, int]] = {
    "ahead, whatever its stamp": (1, [(5, 1000), (6, 999), (7, 500), (9, 1)], [5, 6, 7, 9], 0, 1),
    "no gap before the first one": (2, [(4_000_000_000,)], [4_000_000_000], 0, 0),
    "numbers wrap": (2, [(2**32 - 1,), (0,), (2,)], [2**32 - 1, 0, 2], 0, 1),
    "an outage": (2, [(5,), (9000, 1009), (9001, 1010), (9002, 1011)], [5, 9001, 9002], 1, 8995),
    "no consecutive jumps": (2, [(5,), (9000,), (6,), (9001,), (7,)], [5, 6, 7], 2, 0),
    "a clock set back by more than any delay": (2, [(5, 1000), (6, 997.9)], [5, 6], 0, 0),
    "a clock set back": (2, [(6, 998), (7, 997.4), (8, 997.5), (9, 997.6)], [6, 8, 9], 1, 1),
    "transforms mix their stamps": (35, [(0, 1000), (1, 999.9), (2, 999.8)], [0, 1, 2], 0, 0),
    "a restart has newer stamps": (2, [(9, 1000), (0, 1000.1), (1, 1000.2)], [9, 0, 1], 0, 0),
    "a low number before 1 s of silence": (2, [(1000, 1, 4), (254, 0, 4.999)], [1000], 1, 0),
    "a low number after 1 s of silence": (2, [(1000, 1, 4), (255, 0, 5)], [1000, 255], 0, 0),
    "no low number": (2, [(1000, 1, 4), (256, 0, 5)], [1000], 1, 0),
    "late datagrams don't end a silence": (
        *(2, [(100,), *((tenth, 5, tenth / 10) for tenth in range(1, 11))], [100, 10], 9, 0),
    ),
    "a restart repeats all": (2, [(0,), (1,), (0, 1000, 2), (1, 1000, 2)], [0, 1, 0, 1], 0, 0),
    "a low number ahead after silence": (2, [(5,), (8, 1000, 2)], [5, 8], 0, 2),
    "older than the last of a row": (2, [(5, 1000), (6, 1002), (4, 1001)], [5, 6], 1, 0),
    "silence since the last of a row": (
        *(2, [(5,), (6, 1000, 0.9), (3, 1000, 1.5), (2, 1000, 1.95)], [5, 6, 2], 1, 0),
    ),
}
"""msg_type; seq_number, stamp and arrival in seconds; delivered, late and missing messages."""


@pytest.mark.parametrize(("msg_type", "rows", "got", "late", "missing"), ORDER.values(), ids=ORDER)
def test_order(msg_type: int, rows: Rows, got: list[int], late: int, missing: int) -> None:
    receiver, delivered = Receiver(), []
    for seq, *rest in rows:
        stamp, receiver.now_s = (*rest, *(1000.0, 0.0)[len(rest) :])
        delivered += receiver.seqs(imu(int(seq), stamp)._replace(msg_type=msg_type))
    counters = receiver.reassembler.counters
    assert (delivered, counters.late, counters.missing) == (got, late, missing)
    assert set(receiver.counts) <= {"messages", "late", "missing"}


@pytest.mark.parametrize(
    ("rows", "delivered"),
    [
        ([(1000, 1000), (998, 998), (1001, 1000)], [1000, 998, 1001]),
        ([(5, 1000), (6, 999.9), (7, 1000.1)], [5, 6, 7]),  # the second one is stale
    ],
)
def test_late_messages_are_kept_on_request(rows: Rows, delivered: list[int]) -> None:
    receiver = Receiver(keep_late=True)
    assert receiver.seqs(*(imu(int(seq), stamp) for seq, stamp in rows)) == delivered
    assert "late" not in receiver.counts


@pytest.mark.parametrize(
    ("ahead", "delivered"),
    [(2999, 3), (3000, 2), (2**31 - 1, 2), (2**31, 2), (-103, 2), (-100, 0)],
)
def test_numbers_jump_from_3000_ahead_and_beyond_100_behind(ahead: int, delivered: int) -> None:
    receiver = Receiver()
    in_a_row = [(7 + ahead + more) % 2**32 for more in range(3)]
    receiver.seqs(cloud(7, 1000, 1))
    got = receiver.seqs(*(cloud(seq, 990, 1) for seq in in_a_row))
    assert got == in_a_row[3 - delivered :]
    assert receiver.counts.get("late", 0) == 3 - delivered


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("ahead", [1, 50, 2999, 3000, 1 << 30, 2**31 - 1, 2**31, -1000, -50])
@pytest.mark.parametrize("forgeries", [1, 2])
def test_a_forged_number_costs_some_messages_and_silences_nothing(
    ahead: int, parts: int, forgeries: int, receiver: Receiver
) -> None:
    """One of the year 2038, or two in a row, with numbers far ahead of those of the sender."""
    for number in range(5000, 5010):
        receiver.parts(cloud(number, 1000 + number, parts), range(parts))
    for more in range(forgeries):
        forged = cloud((5009 + ahead + more) % 2**32, 2**31 - 1, parts)
        receiver.parts(forged, range(parts))
    got = []
    for number in range(5010, 5210):
        got += receiver.parts(cloud(number, 1000 + number, parts), range(parts))
    assert [message.seq_number for message in got][-96:] == list(range(5114, 5210))


def test_sequence_jump_is_not_reported(receiver: Receiver) -> None:
    receiver.seqs(imu(5), imu(6), imu(6 + 2**20), imu(7))
    ((_, _, report),) = receiver.reassembler.reports("a", 0)
    assert (report.numbers, report.missing) == (3, 0)
    assert receiver.counts == {"messages": 3, "late": 1}


def test_parts_of_an_open_message_do_not_jump(receiver: Receiver) -> None:
    receiver.parts(cloud(5, 1000), (0, 1, 2))
    receiver.parts(cloud(2000, 1001), range(4))
    receiver.parts(cloud(4500, 1002), range(4))
    receiver.parts(cloud(5, 1000), (3,))
    assert receiver.counts == {"messages": 2, "missing": 2499, "late": 1}


# Stale stamps.


@pytest.mark.parametrize("msg_type", sorted(STAMP_ORDERED))
def test_a_stale_command_or_measurement_is_dropped_though_its_number_is_ahead(
    msg_type: int, receiver: Receiver
) -> None:
    rows = [(5, 1000.0), (6, 999.9), (7, 1000.1), (8, 1000.1), (9, 998.1)]
    headers = [imu(seq, stamp)._replace(msg_type=msg_type) for seq, stamp in rows]
    assert receiver.seqs(*headers) == [5, 7, 8]
    assert receiver.counts == {"messages": 3, "late": 2, "missing": 1}


@pytest.mark.parametrize("stamp", [999.0, 1000.0])
def test_behind_with_an_older_or_equal_stamp_is_late(stamp: float, receiver: Receiver) -> None:
    assert receiver.seqs(imu(1000), imu(998, stamp)) == [1000]
    assert receiver.counts == {"messages": 1, "late": 1}
    receiver.part(imu(998, stamp))
    assert receiver.counts == {"messages": 1, "late": 1, "duplicates": 1}


def test_a_multi_part_message_that_ends_behind_is_late(receiver: Receiver) -> None:
    receiver.parts(cloud(1), (0, 1, 2))
    receiver.parts(cloud(2, 1001), range(4))
    receiver.parts(cloud(1), (3,))
    assert receiver.counts == {"messages": 1, "late": 1}
    assert receiver.reassembler.memory_bytes == 0


def test_restart_after_silence_abandons_open_messages(receiver: Receiver) -> None:
    receiver.parts(cloud(7), range(4))
    receiver.now_s = 0.5
    receiver.part(cloud(8))
    receiver.now_s = 1.0
    receiver.part(cloud(0))
    assert receiver.counts == {"messages": 1, "incomplete": 1}
    assert len(receiver.parts(cloud(0), (1, 2, 3))) == 1


def test_restart_abandons_earlier_open_messages(receiver: Receiver) -> None:
    receiver.parts(cloud(7, 1000), range(4))
    receiver.part(cloud(8, 1001))
    receiver.part(cloud(1, 1003))  # of the new sender, and ahead of its first to be complete
    assert len(receiver.parts(cloud(0, 1002), range(4))) == 1
    assert receiver.counts == {"messages": 2, "incomplete": 1}
    assert len(receiver.parts(cloud(1, 1003), (1, 2, 3))) == 1
    assert receiver.counts == {"messages": 3, "incomplete": 1}


# Consecutive messages, as nearly all are.


def test_the_next_one_that_was_given_up_does_not_come_back_in_a_single_part() -> None:
    receiver = Receiver()
    assert receiver.seqs(imu(5)) == [5]
    receiver.part(imu(6)._replace(parts_max=2), 0)
    receiver.now_s = 2.5
    assert receiver.seqs(imu(6)) == []
    assert receiver.counts == {"messages": 1, "incomplete": 1, "duplicates": 1}


def test_topics_types_and_senders_have_an_order_of_their_own(receiver: Receiver) -> None:
    receiver.seqs(imu(1000))
    assert receiver.seqs(imu(5)._replace(topic="/other"), imu(5)._replace(msg_type=9)) == [5, 5]
    assert receiver.part(imu(5), sender="b") is not None


# Given up.


def test_a_message_is_given_up_after_its_time() -> None:
    receiver = Receiver(time_limit_nanos=10**9)
    receiver.part(POINTS, 0)
    receiver.now_s = 0.9
    receiver.part(POINTS, 1)  # a further part buys no time
    receiver.reassembler.expire(999_999_999)
    assert receiver.counts == {}
    receiver.reassembler.expire(10**9)
    assert receiver.counts == {"incomplete": 1}
    assert receiver.reassembler.memory_bytes == 0


def test_time_is_over_without_anybody_calling_expire() -> None:
    receiver = Receiver(time_limit_nanos=10**9)
    receiver.part(POINTS, 0)
    receiver.now_s = 1.5
    receiver.part(IMU)
    assert receiver.counts == {"messages": 1, "incomplete": 1}


def test_further_parts_of_a_message_given_up_do_not_open_it_again() -> None:
    receiver = Receiver(time_limit_nanos=10**9)
    receiver.part(POINTS, 0)
    receiver.now_s = 1.5
    receiver.parts(POINTS, (1, 2, 3))
    receiver.reassembler.give_up_all()
    assert receiver.counts == {"incomplete": 1, "duplicates": 3}


def test_the_oldest_of_five_open_messages_of_a_topic_is_given_up(receiver: Receiver) -> None:
    for seq in range(5):
        receiver.part(cloud(seq))
    assert receiver.counts == {"incomplete": 1}
    assert receiver.parts(cloud(0), (1, 2, 3)) == []
    assert len(receiver.parts(cloud(1), (1, 2, 3))) == 1


def test_memory_counts_message_sizes(receiver: Receiver) -> None:
    receiver.part(cloud(1, parts=200), 0)
    first = OVERHEAD_BYTES + 200 * PART
    assert receiver.reassembler.memory_bytes == first
    receiver.part(cloud(1, parts=200), 7)
    assert receiver.reassembler.memory_bytes == first
    receiver.part(cloud(2, parts=10), 9, 30)  # a last part alone is kept aside
    assert receiver.reassembler.memory_bytes == first + OVERHEAD_BYTES + 30
    receiver.part(cloud(2, parts=10), 0)
    assert receiver.reassembler.memory_bytes == first + OVERHEAD_BYTES + 10 * PART
    receiver.part(cloud(3, parts=200), 0, 1000)  # large blocks are those of the pool
    assert receiver.reassembler.memory_bytes - first - OVERHEAD_BYTES - 10 * PART == (
        OVERHEAD_BYTES + 4 * 65_536
    )
    receiver.reassembler.give_up_all()
    assert receiver.reassembler.memory_bytes == 0


def test_a_sender_holds_a_quarter_and_loses_its_own_oldest() -> None:
    size = OVERHEAD_BYTES + 5 * PART
    receiver = Receiver(memory_bytes=4 * (2 * size + 100))
    for sender in "ab":
        receiver.part(IMU, sender=sender)
    receiver.part(cloud(1, parts=5)._replace(topic="/b"), 0, sender="b")
    receiver.part(cloud(1, parts=5), 0)
    receiver.part(cloud(2, parts=5), 0)
    assert receiver.counts == {"messages": 2}
    receiver.part(cloud(3, parts=2), 0)
    assert receiver.counts == {"messages": 2, "incomplete": 1}
    assert receiver.parts(cloud(1, parts=5), range(1, 5)) == []
    assert len(receiver.parts(cloud(2, parts=5), range(1, 5))) == 1


def test_a_message_larger_than_a_share_is_given_up_at_once() -> None:
    receiver = Receiver(memory_bytes=4000)
    receiver.parts(cloud(1, parts=11), range(11))
    assert receiver.counts == {"incomplete": 1, "duplicates": 10}
    assert receiver.reassembler.memory_bytes == 0


def test_all_senders_together_keep_to_the_memory() -> None:
    receiver = Receiver(memory_bytes=5 * OVERHEAD_BYTES + 4000)
    for sender in range(5):
        receiver.part(IMU, sender=sender)
        receiver.part(cloud(1, parts=6 + sender), 0, sender=sender)
    assert receiver.counts == {"messages": 5}  # 600 to 1000: that is all of it
    receiver.part(cloud(2, parts=2), 0, sender=0)
    assert receiver.counts == {"messages": 5, "incomplete": 1}
    assert receiver.part(cloud(1, parts=6), 1, sender=0) is None  # its own oldest gave way
    assert receiver.counts == {"messages": 5, "incomplete": 1, "duplicates": 1}
    receiver.part(cloud(1, parts=6), 0, sender="newcomer")  # takes from who holds most
    assert receiver.counts == {"messages": 5, "incomplete": 2, "duplicates": 1}
    receiver.part(cloud(1, parts=10), 1, sender=4)
    assert receiver.counts == {"messages": 5, "incomplete": 2, "duplicates": 2}


def test_the_largest_message_fits_into_a_senders_share() -> None:
    limits = Limits()
    assert 255 * (65507 - 20) <= limits.memory_bytes // limits.share


def test_no_memory_is_taken_before_it_is_filled(receiver: Receiver) -> None:
    message = None
    for number in range(255):
        message = receiver.part(cloud(1, parts=255), number, 4)
    assert message is not None
    assert len(message.body) == 255 * 4


def test_a_new_sender_replaces_the_one_silent_longest() -> None:
    receiver = Receiver(senders=3)
    for sender in "abc":
        receiver.part(POINTS, 0, sender=sender)
    receiver.part(IMU, sender="a")
    receiver.part(POINTS, 0, sender="d")
    assert receiver.counts == {"messages": 1, "incomplete": 1}
    assert [receiver.part(imu(1), sender="a"), receiver.counts["late"]] == [None, 1]
    assert receiver.part(imu(1), sender="b") is not None


def test_too_many_topics_cost_the_sender_its_own_oldest() -> None:
    receiver = Receiver(topics=3)
    for topic in ("/quiet", "/quieter"):
        receiver.part(imu(9)._replace(topic=topic), sender="b")
    for topic in ("/1", "/2", "/3"):
        receiver.part(imu(9)._replace(topic=topic))
    for topic in ("/quiet", "/quieter"):  # are known, so that this is late
        assert receiver.part(imu(1)._replace(topic=topic), sender="b") is None
    assert receiver.part(imu(1)._replace(topic="/3")) is None
    assert receiver.part(imu(1)._replace(topic="/1")) is not None  # was forgotten


def test_the_oldest_topic_is_the_one_silent_longest() -> None:
    receiver = Receiver(topics=2)
    for topic in ("/1", "/2", "/1", "/3"):
        receiver.part(imu(9)._replace(topic=topic))
    assert [topic for topic, _, _ in receiver.reassembler.reports("a", 0)] == ["/1", "/3"]


def test_a_newcomer_takes_a_topic_from_the_sender_with_most() -> None:
    receiver = Receiver(topics=3)
    receiver.part(imu(9)._replace(topic="/quiet"), sender="b")
    for topic in ("/1", "/2"):
        receiver.part(imu(9)._replace(topic=topic))
    receiver.part(imu(9), sender="newcomer")
    assert receiver.part(imu(1)._replace(topic="/quiet"), sender="b") is None
    assert receiver.part(imu(1)._replace(topic="/2")) is None
    assert [topic for topic, _, _ in receiver.reassembler.reports("a", 0)] == ["/2"]


# Counting by topic, and type 64.


def test_losses_are_counted_by_topic_too(receiver: Receiver) -> None:
    receiver.seqs(imu(1), imu(5), imu(4), imu(5))
    receiver.part(cloud(1), 0)
    receiver.reassembler.give_up_all()
    reports = {
        (report.msg_type, topic, link): report
        for topic, link, report in receiver.reassembler.reports("a", 0)
    }
    of_imu = reports[2, "/imu", "imu"]
    assert (of_imu.numbers, of_imu.pending, of_imu.late, of_imu.missing) == (5, 2, 1, 2)
    assert (of_imu.duplicates, of_imu.incomplete) == (1, 0)
    assert reports[1, "/points", "lidar"].incomplete == 1
    assert receiver.reassembler.reports("nobody", 0) == []


def test_control_is_delivered_whatever_its_number_and_stamp(receiver: Receiver) -> None:
    credit = bytes([0, 1, 0, 0]) + bytes(8)
    for seq, sec in ((9, 1000), (3, 900), (3, 900)):
        header = Header(64, seq, 0, 1, sec, 0, "/points")
        message = receiver.reassembler.receive(header.pack() + credit, "a", 0)
        assert message is not None
    assert receiver.counts == {"messages": 3}


def test_control_of_several_parts_or_with_a_bad_body_is_refused(receiver: Receiver) -> None:
    receiver.part(Header(64, 0, 0, 2, 0, 0), 0, 12)
    receiver.part(Header(64, 12, 0, 1, 0, 0), 0, 12)  # its body says kind 12
    receiver.part(Header(64, 7, 0, 1, 0, 0), 0, 0)
    assert receiver.counts == {"refused": {"parts_max": 1, "body_value": 1, "body_size": 1}}


@settings(max_examples=50)
@given(st.data())
def test_whatever_arrives_the_limits_hold(data: st.DataObject) -> None:
    receiver = Receiver(memory_bytes=8000, senders=3, topics=5, time_limit_nanos=10**9)
    reassembler = receiver.reassembler
    for _ in range(60):
        parts_max = data.draw(st.integers(1, 12))
        header = Header(
            msg_type=1,
            seq_number=data.draw(st.integers(0, 8)),
            part_number=0,
            parts_max=parts_max,
            time_sec=data.draw(st.integers(0, 1)),
            time_nsec=0,
            topic=data.draw(st.sampled_from(["/a", "/b", "/c", "/d"])),
        )
        receiver.now_s += data.draw(st.sampled_from([0, 0.01, 0.6]))
        receiver.part(
            header,
            data.draw(st.integers(0, parts_max - 1)),
            data.draw(st.sampled_from([0, 1, 100, 300])),
            data.draw(st.sampled_from("abcde")),
        )
        assert 0 <= reassembler.memory_bytes <= 8000
        tallied = [len(reassembler.reports(sender, 0)) for sender in "abcde"]
        assert sum(tallied) <= 5
        assert sum(map(bool, tallied)) <= 3
    reassembler.give_up_all()
    assert reassembler.memory_bytes == 0


def test_a_subscribe_of_several_parts_or_with_a_bad_body_is_refused(receiver: Receiver) -> None:
    head = Header(7, 0, 0, 1, 0, 0, "/odom")
    for body in (b"", bytes(7), bytes(8), bytes(9)):
        assert receiver.reassembler.receive(head.pack() + body, "sender", 0) is None
    halves = head._replace(parts_max=2)
    for number in range(2):
        part = halves._replace(part_number=number).pack() + bytes(4)
        assert receiver.reassembler.receive(part, "sender", 0) is None
    assert receiver.counts == {"refused": {"body_size": 3, "body_value": 1, "parts_max": 2}}
