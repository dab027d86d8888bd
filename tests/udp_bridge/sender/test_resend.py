# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge import Header, Message, parse
from udp_bridge.sender.flow_control import DEFAULT_RECEIVE_BUFFER
from udp_bridge.sender.repair import Resend
from udp_bridge.sender.resend import (
    BUDGET_WINDOW_S,
    BURST_BYTES,
    HISTORY_MESSAGES,
    MINIMUM_BYTES,
    ResendBudget,
)
from udp_bridge.sender.send_queue import OutgoingDatagram, SendQueue
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.message import DatagramKey
from udp_bridge.wire.repair import Offer, Request, parse_resend

MS = 1_000_000
SECOND = 1000 * MS
TO = ("192.0.2.1", 4000)
PARTS = 5
PART = 1440


def box(limit: int = 500 * MS) -> SendQueue:
    queue = SendQueue(TO, "mtu", repair={(kind, "/p"): Resend(limit) for kind in (1, 2)})
    queue.flow.bucket.rate_bytes_per_s = 1e12
    queue.flow.bucket.burst_bytes = 10**9
    acknowledge(queue, 2 * 10**9)
    return queue


def acknowledge(queue: SendQueue, receive_buffer: int) -> None:
    """Give a Credit, so that none is asked for."""
    queue.flow.acknowledged(DatagramKey(1, "", 0, 0), receive_buffer, 0)


@pytest.fixture
def queue() -> SendQueue:
    return box()


def taken(queue: SendQueue, now: int) -> list[tuple[Header, bytes]]:
    out: list[tuple[Header, bytes]] = []
    datagram: OutgoingDatagram | None = queue.take(now)
    while datagram is not None:
        data = datagram.header + bytes(datagram.part)
        header, offset = parse(data)
        out.append((header, data[offset:]))
        datagram = queue.take(now)
    return out


def cloud(stamp: int = 7, parts: int = PARTS) -> Message:
    return Message(1, "/p", "link", stamp, 0, bytes(range(250)) * 6 * parts)


def put(queue: SendQueue, now: int, message: Message | None = None) -> list[tuple[Header, bytes]]:
    """Send a message; return its datagrams, without the offer."""
    queue.put(message or cloud())
    return [row for row in taken(queue, now) if row[0].msg_type != 65]


def ask(
    queue: SendQueue, header: Header, parts: tuple[int, ...], now: int, goodput: int = 0
) -> None:
    request = Request(header.msg_type, header.parts_max, 1, goodput, parts)
    queue.resender.requested(header, request, now)


def test_parts_are_resent_byte_for_byte(queue: SendQueue) -> None:
    sent = put(queue, 0)
    ask(queue, sent[0][0], (1, 4), MS)
    assert not queue.is_idle
    again = [row for row in taken(queue, MS) if row[0].msg_type == 1]
    assert again == [sent[1], sent[4]]
    assert queue.is_idle
    assert queue.resender.resent == 2


def test_the_offer_goes_right_behind_the_last_part(queue: SendQueue) -> None:
    queue.put(cloud())
    datagrams = [queue.take(0, 3 * 1500), queue.take(0, 3 * 1500)]
    behind = [row.batch.trailer for row in datagrams if row is not None and row.batch is not None]
    assert behind[0] is None
    assert behind[1] is not None
    header, offset = parse(behind[1])
    assert header.msg_type == 65
    assert parse_resend(memoryview(behind[1])[offset:]) == Offer(1, PARTS + 1, 500)
    assert queue.take(0, 3 * 1500) is None  # it does not go twice
    assert queue.next_wake(0) == MS


def test_they_go_before_parts_of_newer_messages_and_behind_small_ones(queue: SendQueue) -> None:
    sent = put(queue, 0)
    ask(queue, sent[0][0], (2,), MS)
    queue.put(cloud(8))
    queue.put(Message(8, "/clock", "", 1, 0, b"t"))
    kinds = [
        (header.msg_type, header.seq_number, header.part_number)
        for header, _ in taken(queue, MS)
        if header.msg_type != 65
    ]
    assert kinds[:3] == [(8, 0, 0), (1, 0, 2), (1, 1, 0)]


def test_requests_for_unsent_or_other_messages_are_ignored(queue: SendQueue) -> None:
    queue.put(cloud())
    first, *_ = [queue.take(0), queue.take(0)]
    assert first is not None
    header, _ = parse(first.header)
    ask(queue, header, (0, 1, 2, 3), 0)
    ask(queue, header._replace(time_nsec=9), (0,), 0)
    ask(queue, header._replace(parts_max=9), (0,), 0)
    ask(queue, header._replace(seq_number=5), (0,), 0)
    ask(queue, header._replace(topic="/q"), (0,), 0)
    numbers = [header.part_number for header, _ in taken(queue, 0) if header.msg_type == 1]
    assert numbers == [0, 1, 2, 3, 4, 5]  # 0 and 1 again, the others for the first time
    assert queue.resender.resent == 2


@pytest.mark.parametrize(
    "other", [{"time_nsec": 6}, {"time_nsec": 9}, {"parts_max": 3}, {"parts_max": 9}]
)
def test_parts_of_another_message_of_the_number_are_not_sent(other: dict[str, int]) -> None:
    queue = box()
    sent = put(queue, 0)
    ask(queue, sent[0][0]._replace(**other), (1,), MS)
    assert [h for h, _ in taken(queue, MS) if h.msg_type == 1] == []
    assert queue.resender.resent == 0


def test_complete_messages_are_resent(queue: SendQueue) -> None:
    rows = [put(queue, 0, Message(2, "/p", "", stamp, 0, b"imu")) for stamp in range(4)]
    queue.resender.requested(rows[1][0][0]._replace(time_nsec=999), Request(2, 0, 2, 0), MS)
    again = [row for row in taken(queue, MS) if row[0].msg_type == 2]
    assert again == [*rows[1], *rows[2]]


def test_stale_messages_are_forgotten() -> None:
    queue = box(limit=100 * MS)
    sent = put(queue, 0)
    ask(queue, sent[0][0], (1,), 100 * MS)
    ask(queue, sent[0][0], (2,), 100 * MS + 1)
    assert queue.resender.history_bytes == 0
    assert [h for h, _ in taken(queue, 101 * MS) if h.msg_type == 1] == []
    assert queue.resender.resent == 0


def test_copies_of_a_request_are_answered_once(queue: SendQueue) -> None:
    sent = put(queue, 0)
    for _ in range(2):
        ask(queue, sent[0][0], (1,), MS)
        taken(queue, MS)
    assert queue.resender.resent == 1
    ask(queue, sent[0][0], (1,), 3 * MS)
    taken(queue, 3 * MS)
    assert queue.resender.resent == 2


def test_parts_lost_again_may_be_requested_again_at_once(queue: SendQueue) -> None:
    sent = put(queue, 0)
    ask(queue, sent[0][0], (1, 3), MS)
    taken(queue, MS)
    ask(queue, sent[0][0], (1,), MS + 1)
    taken(queue, MS + 1)
    assert queue.resender.resent == 3


def test_an_offer_follows_requested_parts(queue: SendQueue) -> None:
    sent = put(queue, 0)
    taken(queue, 15 * MS)
    ask(queue, sent[0][0], (1, 3), 16 * MS)
    again = taken(queue, 16 * MS)
    assert again[:2] == [sent[1], sent[3]]
    assert [header.msg_type for header, _ in again[2:]] == [65]
    assert queue.next_wake(16 * MS) == 17 * MS  # the next ones follow as in the beginning


def test_an_offer_follows_a_single_part_a_millisecond_later(queue: SendQueue) -> None:
    sent = put(queue, 0)
    taken(queue, 15 * MS)
    ask(queue, sent[0][0], (1,), 16 * MS)
    assert taken(queue, 16 * MS) == [sent[1]]
    assert queue.next_wake(16 * MS) == 17 * MS


def test_an_older_message_hastens_no_offer_of_the_newest(queue: SendQueue) -> None:
    sent = put(queue, 0)
    put(queue, 0, cloud(8))
    taken(queue, 15 * MS)
    ask(queue, sent[0][0], (1, 2), 16 * MS)
    assert taken(queue, 16 * MS) == sent[1:3]


def test_an_offer_waits_for_requested_parts(queue: SendQueue) -> None:
    sent = put(queue, 0)
    queue.flow.window.window_bytes = 1  # full, so nothing goes again until there is a credit
    queue.flow.window.moved_nanos = 16 * MS
    ask(queue, sent[0][0], (1, 2), 16 * MS)
    assert taken(queue, 16 * MS) == []
    wake = queue.next_wake(16 * MS)
    assert wake is not None
    assert wake > 16 * MS


def test_parts_beyond_the_budget_are_not_resent() -> None:
    queue = SendQueue(TO, 65_000, repair={(1, "/p"): Resend(5 * SECOND)})
    acknowledge(queue, DEFAULT_RECEIVE_BUFFER)
    queue.flow.window.window_bytes = 10**9
    sent = put(queue, 0, Message(1, "/p", "", 7, 0, bytes(1_500_000)))
    ask(queue, sent[0][0], tuple(range(20)), MS)
    taken(queue, MS)
    assert queue.resender.resent == BURST_BYTES // 65_000
    assert queue.resender.over_budget == 20 - queue.resender.resent


@pytest.mark.parametrize("datagram", ["mtu", "loopback"])
def test_a_small_message_takes_its_own_size_of_the_budget(datagram: DatagramSize) -> None:
    queue = SendQueue(TO, datagram, repair={(2, "/p"): Resend(5 * SECOND)})
    acknowledge(queue, DEFAULT_RECEIVE_BUFFER)
    queue.flow.window.window_bytes = 10**9
    for stamp in range(1000):
        put(queue, 0, Message(2, "/p", "", stamp, 0, bytes(100)))
    for first in range(0, 1000, 50):
        header = Header(2, first, 0, 1, 0, 0, "/p")
        queue.resender.requested(header, Request(2, 0, 50, 0), 0)
        taken(queue, 0)
    assert (queue.resender.resent, queue.resender.over_budget) == (1000, 0)


def spent(budget: ResendBudget, goodput: int, now: int, size: int = 1000) -> int:
    budget.goodput_reported(goodput, now)
    count = 0
    while budget.spend(size, now):
        count += size
    return count


def test_in_the_long_run_a_quarter_of_the_goodput_is_resent() -> None:
    budget = ResendBudget()
    goodput, count = 3_000_000, 0
    for tenth in range(400):
        now = tenth * SECOND // 10
        budget.sent(400_000, now)
        came = spent(budget, goodput, now)
        count += came if tenth >= 200 else 0
    assert count == pytest.approx(20 * goodput / BUDGET_WINDOW_S, rel=0.01)


@pytest.mark.parametrize("left", [0, 500_000, 2_000_000])
def test_a_burst_is_repaired_at_any_goodput_but_not_more_than_was_sent(left: int) -> None:
    budget = ResendBudget()
    budget.sent(left, 0)
    most = max(MINIMUM_BYTES, min(left, BURST_BYTES))
    assert spent(budget, 0, 1) == most // 1000 * 1000
    assert spent(budget, 0, BUDGET_WINDOW_S * SECOND) == 0
    budget.sent(left, BUDGET_WINDOW_S * SECOND)
    assert spent(budget, 0, BUDGET_WINDOW_S * SECOND + 1) == most // 1000 * 1000


def test_claims_beyond_sent_messages_are_ignored() -> None:
    budget = ResendBudget()
    budget.sent(20_000_000, 0)
    assert spent(budget, 1 << 31, 1) == 20_000_000 // BUDGET_WINDOW_S


def test_a_pause_does_not_reduce_the_budget() -> None:
    budget = ResendBudget()
    budget.sent(400_000_000, 0)
    assert spent(budget, 90_000_000, SECOND // 2, 10_000_000) == 90_000_000
    budget.sent(10_000_000, 2 * SECOND)
    assert spent(budget, 9_500_000, 2 * SECOND) == 0  # still as much as the best second allows
    budget = ResendBudget()
    budget.sent(400_000_000, 0)
    budget.goodput_reported(90_000_000, SECOND // 2)
    assert budget.spend(20_000_000, SECOND // 2)
    budget.sent(10_000_000, 2 * SECOND)
    budget.goodput_reported(9_500_000, 2 * SECOND)
    assert budget.spend(1_000_000, 2 * SECOND)
    # What was told so long ago as what was spent for it counts no more.
    now = SECOND // 2 + BUDGET_WINDOW_S * SECOND
    assert spent(budget, 1_500_000, now) == 10_000_000 // BUDGET_WINDOW_S - 1_000_000


def test_arrivals_before_the_window_are_ignored() -> None:
    budget, now = ResendBudget(), BUDGET_WINDOW_S * SECOND
    budget.goodput_reported(90_000_000, 0)
    budget.sent(400_000_000, now)
    assert spent(budget, 0, now, 100_000) <= BURST_BYTES


def test_falling_goodput_fills_no_memory() -> None:
    budget = ResendBudget()
    for index in range(10_000):
        budget.goodput_reported(10**6 - index, index * MS)
    assert len(budget._goodput) <= 10 * BUDGET_WINDOW_S + 1


def test_history_is_bounded(queue: SendQueue) -> None:
    for stamp in range(HISTORY_MESSAGES + 10):
        put(queue, 0, Message(2, "/p", "", stamp, 0, b"x"))
    assert queue.resender.history_bytes == HISTORY_MESSAGES
    queue = box()
    for stamp in range(12):
        queue.put(Message(1, "/p", "", stamp, 0, bytes(16_000_000)))
        taken(queue, 0)
    assert queue.resender.history_bytes == 4 * 16_000_000


def offers(queue: SendQueue, until: int, step: int = MS // 2) -> list[tuple[int, Header, Offer]]:
    out = []
    for now in range(0, until, step):
        for header, body in taken(queue, now):
            if header.msg_type == 65:
                offer = parse_resend(body)
                assert isinstance(offer, Offer)
                out.append((now // MS, header, offer))
    return out


def test_offers_follow_a_message_until_it_is_stale() -> None:
    queue = box(limit=100 * MS)
    queue.put(cloud())
    out = offers(queue, 300 * MS)
    assert [when for when, _, _ in out] == [0, 1, 3, 7, 15, 31, 51, 71, 91]
    assert {offer for _, _, offer in out} == {Offer(1, 6, 100)}
    assert {header.stamp_nanos for _, header, _ in out} == {7}
    assert queue.next_wake(300 * MS) is None


def test_an_offer_names_the_newest_message(queue: SendQueue) -> None:
    put(queue, 0)
    queue.put(cloud(8))
    (_, header, _), *_ = offers(queue, MS)
    assert (header.seq_number, header.stamp_nanos, header.link) == (1, 8, "")


def test_fast_topics_are_offered_at_most_every_5_ms(queue: SendQueue) -> None:
    count = 0
    for now in range(0, SECOND, 2_500_000):
        queue.put(Message(2, "/p", "", now, 0, b"x"))
        count += sum(header.msg_type == 65 for header, _ in taken(queue, now))
    assert count == 200


def test_other_topics_are_not_kept_and_not_offered(queue: SendQueue) -> None:
    queue.put(Message(1, "/other", "", 1, 0, bytes(9000)))
    assert all(header.msg_type == 1 for header, _ in taken(queue, 0))
    assert queue.resender.history_bytes == 0
    assert queue.next_wake(0) is None
