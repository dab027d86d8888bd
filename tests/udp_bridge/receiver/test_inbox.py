# SPDX-License-Identifier: Apache-2.0
from typing import Any

import pytest

from udp_bridge import Header, Message, fragments, parse
from udp_bridge.receiver.delivery_reports import Answer
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.wire import control
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, TopicReport
from udp_bridge.wire.message import DatagramKey

SENDER = ("192.0.2.7", 5000)
OTHER = ("192.0.2.8", 5000)
SECOND = 10**9
WALL = 10**18


class Bench:
    """An inbox, and what came out of it."""

    def __init__(self, receive_buffer: int = 212_992) -> None:
        self.credits_taken: list[tuple[Any, ...]] = []
        self.inbox = Inbox(
            receive_buffer=receive_buffer, on_credit=lambda *taken: self.credits_taken.append(taken)
        )

    def receive(
        self, message: Message, size: int = 1472, now: int = 0, sender: tuple[str, int] = SENDER
    ) -> list[tuple[int, Credit]]:
        """Take all datagrams of a message; return the index after which a credit went out."""
        credits = []
        for index, datagram in enumerate(cut(message, size)):
            _, answer = self.inbox.receive(datagram, sender, now)
            if answer is None:
                continue
            header, _ = parse(answer[0])
            credit = body_of(answer)
            assert answer[1] == sender
            assert isinstance(credit, Credit)
            assert (header.msg_type, header.topic, header.link) == (64, message.topic, "")
            assert header.stamp_nanos == message.stamp_nanos
            credits.append((index, credit))
        return credits


@pytest.fixture
def bench() -> Bench:
    return Bench()


def cloud(size: int, seq_number: int = 4) -> Message:
    return Message(1, "/points", "lidar", 123, seq_number, bytes(size))


def cut(message: Message, size: int = 1472) -> list[memoryview]:
    return [memoryview(head + bytes(part)) for head, part in fragments(message, size)]


def body_of(answer: Answer | None) -> control.Control:
    assert answer is not None
    return control.parse(answer[0][parse(answer[0])[1] :])


def test_single_part_messages_get_no_credit(bench: Bench) -> None:
    assert bench.receive(cloud(100)) == []


def test_a_request_for_a_credit_is_answered_and_not_delivered(bench: Bench) -> None:
    head = Header(64, 17, 0, 1, 0, 0).pack()
    request = memoryview(head + CreditRequest().pack())
    message, answer = bench.inbox.receive(request, OTHER, 0)
    assert message is None
    assert body_of(answer) == Credit(64, 0, 17, 212_992)
    assert answer is not None
    assert answer[1] == OTHER
    header, _ = parse(answer[0])
    assert (header.msg_type, header.topic, header.stamp_nanos) == (64, "", 0)


def test_a_finished_message_gets_a_credit_for_its_last_datagram(bench: Bench) -> None:
    assert bench.receive(cloud(5 * 1400)) == [(4, Credit(1, 4, 4, 212_992))]


def test_a_credit_goes_out_when_an_eighth_of_the_buffer_was_taken(bench: Bench) -> None:
    credits = bench.receive(cloud(1432 * 100))
    # 26,624 bytes are an eighth; the 19th datagram of 1472 is the first beyond.
    assert [index for index, _ in credits] == [18, 37, 56, 75, 94, 99]
    assert [credit.part_number for _, credit in credits] == [18, 37, 56, 75, 94, 99]


def test_credit_is_counted_by_sender(bench: Bench) -> None:
    answers = [
        bench.inbox.receive(datagram, sender, 0)[1]
        for datagram in cut(cloud(1432 * 100))[:30]
        for sender in (SENDER, OTHER)
    ]
    assert [index for index, answer in enumerate(answers) if answer] == [36, 37]


def test_a_duplicate_took_buffer_too_and_is_acknowledged() -> None:
    bench = Bench(1000)
    bench.receive(cloud(5000))
    assert len(bench.receive(cloud(5000))) == 4


def test_late_message_completed_within_a_batch_is_acknowledged(bench: Bench) -> None:
    first, *rest = cut(cloud(5000))
    for datagram in (*rest, *cut(cloud(5000, 5))):
        bench.inbox.receive(datagram, SENDER, 0)
    message, answer = bench.inbox.receive(first, SENDER, 0)
    assert message is None
    assert body_of(answer) == Credit(1, 0, 4, 212_992)


def test_the_end_of_an_incomplete_message_is_acknowledged(bench: Bench) -> None:
    assert bench.inbox.receive(cut(cloud(5000))[-1], SENDER, 0)[1] is not None


def test_a_received_credit_is_not_delivered(bench: Bench) -> None:
    body = Credit(1, 26, 41, 8 << 20).pack()
    message = Message(64, "/points", "", 123, 0, body)
    assert bench.receive(message) == []
    assert bench.credits_taken == [(SENDER, DatagramKey(1, "/points", 41, 26), 8 << 20)]


def test_received_reports_are_delivered(bench: Bench) -> None:
    report = LinkReport(1, 2, 3, 4, 5)
    (datagram,) = cut(Message(64, "", "", 123, 0, report.pack()))
    message, answer = bench.inbox.receive(datagram, SENDER, 0)
    assert answer is None
    assert message is not None
    assert control.parse(message.body) == report


def test_refused_datagrams_are_counted_and_get_no_answer(bench: Bench) -> None:
    for datagram in (b"", b"garbage", bytes(100)):
        assert bench.inbox.receive(memoryview(datagram), SENDER, 0) == (None, None)
    assert sum(bench.inbox.reassembler.counters.refused.values()) == 3
    assert bench.inbox.datagrams == 3
    assert bench.inbox.reports(0, WALL) == []


def reported(bench: Bench, now: int) -> dict[tuple[str, int], list[tuple[str, str, object]]]:
    rows: dict[tuple[str, int], list[tuple[str, str, object]]] = {}
    for answer, to in bench.inbox.reports(now, WALL + 5):
        header, offset = parse(answer)
        assert header.msg_type == 64
        assert header.stamp_nanos == WALL + 5
        rows.setdefault(to, []).append((header.topic, header.link, control.parse(answer[offset:])))
    return rows


def test_each_sender_gets_reports_of_what_it_sent(bench: Bench) -> None:
    bench.receive(cloud(5000, 4))
    bench.receive(cloud(5000, 6)._replace(stamp_nanos=223))
    bench.receive(Message(2, "/imu", "imu", 7, 0, b"x"), sender=OTHER)
    bench.inbox.kernel_drops = 9
    bench.inbox.receive(memoryview(b"bad"), OTHER, 0)
    rows = reported(bench, SECOND)
    received = bench.inbox.bytes_received
    total = LinkReport(212_992, bench.inbox.datagrams, received, 1, 9, (("short", 1),))
    waiting = -(1 << 63)
    since = WALL + 5
    points = TopicReport(1, 4, since, 3, 0, 0, 0, 0, 2, 0, 0, 0, 123, 0, 0, waiting, waiting)
    imu = TopicReport(2, 0, since, 1, 0, 0, 0, 0, 1, 0, 0, 0, 7, 0, 0, waiting, waiting)
    assert rows == {
        SENDER: [("/points", "lidar", points), ("", "", total)],
        OTHER: [("/imu", "imu", imu), ("", "", total)],
    }
    assert points.missing == 1
    assert bench.inbox.last_reports == [
        (SENDER, "/points", "lidar", points),
        (OTHER, "/imu", "imu", imu),
    ]
    assert bench.inbox.datagrams == 4 + 4 + 1 + 1


def test_what_was_published_is_reported(bench: Bench) -> None:
    messages = []
    for number in range(3):
        (datagram,) = cut(Message(2, "/imu", "imu", 7 + number, number, b"x"))
        message, _ = bench.inbox.receive(datagram, SENDER, 0)
        assert message is not None
        messages.append(message)
    bench.inbox.mark_published(messages[0], SENDER, WALL)
    bench.inbox.mark_dropped(messages[1], SENDER)
    bench.inbox.mark_published(messages[2], OTHER, WALL)  # nobody that was heard of
    report = reported(bench, SECOND)[SENDER][0][2]
    assert isinstance(report, TopicReport)
    assert (report.published, report.dropped, report.pending) == (1, 1, 1)
    assert report.age_p50_nanos == WALL - 7


def test_a_sender_that_was_silent_for_5_s_gets_no_reports(bench: Bench) -> None:
    bench.receive(cloud(10), now=0)
    bench.receive(cloud(10), now=3 * SECOND, sender=OTHER)
    assert list(reported(bench, 5 * SECOND)) == [SENDER, OTHER]
    assert list(reported(bench, 5 * SECOND + 1)) == [OTHER]


def test_peers_are_bounded(bench: Bench) -> None:
    for port in range(70):
        bench.receive(cloud(10), sender=("192.0.2.9", port))
        bench.receive(cloud(10, port), sender=SENDER)
    told = reported(bench, 0)
    assert len(told) == 64
    (report,) = [row[2] for row in told[SENDER] if isinstance(row[2], TopicReport)]
    assert (report.numbers, report.pending) == (70, 70)
    assert ("192.0.2.9", 0) not in told


def test_control_bodies_are_refused_before_they_are_acted_on(bench: Bench) -> None:
    (datagram,) = cut(Message(64, "/points", "", 123, 0, b"\0\0"))
    bench.inbox.receive(datagram, SENDER, 0)
    assert bench.inbox.reassembler.counters.refused == {"body_size": 1}
    assert bench.credits_taken == []
