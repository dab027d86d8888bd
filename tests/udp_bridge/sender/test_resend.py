# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from udp_bridge import Header, Message, parse
from udp_bridge.sender.credit_window import UNKNOWN_BUFFER
from udp_bridge.sender.outgoing import Datagram
from udp_bridge.sender.repair import Resend
from udp_bridge.sender.resend import HISTORY_MESSAGES
from udp_bridge.sender.resend_budget import BURST_BYTES, LEAST_BYTES, WINDOW_S, Budget
from udp_bridge.sender.send_queue import Outbox
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.message import DatagramKey
from udp_bridge.wire.repair import Offer, Request, parse_resend

MS = 1_000_000
SECOND = 1000 * MS
TO = ("192.0.2.1", 4000)
PARTS = 5
PART = 1440


def box(limit: int = 500 * MS) -> Outbox:
    outbox = Outbox(TO, "mtu", repair={(kind, "/p"): Resend(limit) for kind in (1, 2)})
    outbox.pacer.bucket.rate_bytes_per_s = 1e12
    outbox.pacer.bucket.burst_bytes = 10**9
    acknowledge(outbox, 2 * 10**9)
    return outbox


def acknowledge(outbox: Outbox, receive_buffer: int) -> None:
    """Give a Credit, so that none is asked for."""
    outbox.pacer.acknowledged(DatagramKey(1, "", 0, 0), receive_buffer, 0)


def taken(outbox: Outbox, now: int) -> list[tuple[Header, bytes]]:
    out: list[tuple[Header, bytes]] = []
    datagram: Datagram | None = outbox.take(now)
    while datagram is not None:
        data = datagram.header + bytes(datagram.part)
        header, offset = parse(data)
        out.append((header, data[offset:]))
        datagram = outbox.take(now)
    return out


def cloud(stamp: int = 7, parts: int = PARTS) -> Message:
    return Message(1, "/p", "link", stamp, 0, bytes(range(250)) * 6 * parts)


def put(outbox: Outbox, now: int, message: Message | None = None) -> list[tuple[Header, bytes]]:
    """Send a message; return its datagrams, without the offer."""
    outbox.put(message or cloud())
    return [row for row in taken(outbox, now) if row[0].msg_type != 65]


def ask(outbox: Outbox, header: Header, parts: tuple[int, ...], now: int, goodput: int = 0) -> None:
    request = Request(header.msg_type, header.parts_max, 1, goodput, parts)
    outbox.resender.asked(header, request, now)


def test_parts_go_out_again_byte_for_byte() -> None:
    outbox = box()
    sent = put(outbox, 0)
    ask(outbox, sent[0][0], (1, 4), MS)
    assert not outbox.is_idle
    again = [row for row in taken(outbox, MS) if row[0].msg_type == 1]
    assert again == [sent[1], sent[4]]
    assert outbox.is_idle
    assert outbox.resender.resent == 2


def test_the_offer_goes_right_behind_the_last_part() -> None:
    outbox = box()
    outbox.put(cloud())
    datagrams = [outbox.take(0, 3 * 1500), outbox.take(0, 3 * 1500)]
    behind = [row.run.behind for row in datagrams if row is not None and row.run is not None]
    assert behind[0] is None
    assert behind[1] is not None
    header, offset = parse(behind[1])
    assert header.msg_type == 65
    assert parse_resend(memoryview(behind[1])[offset:]) == Offer(1, PARTS + 1, 500)
    assert outbox.take(0, 3 * 1500) is None  # it does not go twice
    assert outbox.next_wake(0) == MS


def test_they_go_before_parts_of_newer_messages_and_behind_small_ones() -> None:
    outbox = box()
    sent = put(outbox, 0)
    ask(outbox, sent[0][0], (2,), MS)
    outbox.put(cloud(8))
    outbox.put(Message(8, "/clock", "", 1, 0, b"t"))
    kinds = [
        (header.msg_type, header.seq_number, header.part_number)
        for header, _ in taken(outbox, MS)
        if header.msg_type != 65
    ]
    assert kinds[:3] == [(8, 0, 0), (1, 0, 2), (1, 1, 0)]


def test_what_was_not_sent_yet_or_is_another_message_is_not_sent() -> None:
    outbox = box()
    outbox.put(cloud())
    first, *_ = [outbox.take(0), outbox.take(0)]
    assert first is not None
    header, _ = parse(first.header)
    ask(outbox, header, (0, 1, 2, 3), 0)
    ask(outbox, header._replace(time_nsec=9), (0,), 0)
    ask(outbox, header._replace(parts_max=9), (0,), 0)
    ask(outbox, header._replace(seq_number=5), (0,), 0)
    ask(outbox, header._replace(topic="/q"), (0,), 0)
    numbers = [header.part_number for header, _ in taken(outbox, 0) if header.msg_type == 1]
    assert numbers == [0, 1, 2, 3, 4, 5]  # 0 and 1 again, the others for the first time
    assert outbox.resender.resent == 2


@pytest.mark.parametrize(
    "other", [{"time_nsec": 6}, {"time_nsec": 9}, {"parts_max": 3}, {"parts_max": 9}]
)
def test_parts_of_another_message_of_the_number_are_not_sent(other: dict[str, int]) -> None:
    outbox = box()
    sent = put(outbox, 0)
    ask(outbox, sent[0][0]._replace(**other), (1,), MS)
    assert [h for h, _ in taken(outbox, MS) if h.msg_type == 1] == []
    assert outbox.resender.resent == 0


def test_whole_messages_are_sent_again() -> None:
    outbox = box()
    rows = [put(outbox, 0, Message(2, "/p", "", stamp, 0, b"imu")) for stamp in range(4)]
    outbox.resender.asked(rows[1][0][0]._replace(time_nsec=999), Request(2, 0, 2, 0), MS)
    again = [row for row in taken(outbox, MS) if row[0].msg_type == 2]
    assert again == [*rows[1], *rows[2]]


def test_stale_messages_are_forgotten() -> None:
    outbox = box(limit=100 * MS)
    sent = put(outbox, 0)
    ask(outbox, sent[0][0], (1,), 100 * MS)
    ask(outbox, sent[0][0], (2,), 100 * MS + 1)
    assert outbox.resender.history_bytes == 0
    assert [h for h, _ in taken(outbox, 101 * MS) if h.msg_type == 1] == []
    assert outbox.resender.resent == 0


def test_copies_of_a_request_are_answered_once() -> None:
    outbox = box()
    sent = put(outbox, 0)
    for _ in range(2):
        ask(outbox, sent[0][0], (1,), MS)
        taken(outbox, MS)
    assert outbox.resender.resent == 1
    ask(outbox, sent[0][0], (1,), 3 * MS)
    taken(outbox, 3 * MS)
    assert outbox.resender.resent == 2


def test_what_is_lost_again_may_be_asked_for_again_at_once() -> None:
    outbox = box()
    sent = put(outbox, 0)
    ask(outbox, sent[0][0], (1, 3), MS)
    taken(outbox, MS)
    ask(outbox, sent[0][0], (1,), MS + 1)
    taken(outbox, MS + 1)
    assert outbox.resender.resent == 3


def test_an_offer_goes_behind_what_was_asked_for() -> None:
    outbox = box()
    sent = put(outbox, 0)
    taken(outbox, 15 * MS)
    ask(outbox, sent[0][0], (1, 3), 16 * MS)
    again = taken(outbox, 16 * MS)
    assert again[:2] == [sent[1], sent[3]]
    assert [header.msg_type for header, _ in again[2:]] == [65]
    assert outbox.next_wake(16 * MS) == 17 * MS  # the next ones follow as in the beginning


def test_an_offer_follows_a_single_part_a_millisecond_later() -> None:
    outbox = box()
    sent = put(outbox, 0)
    taken(outbox, 15 * MS)
    ask(outbox, sent[0][0], (1,), 16 * MS)
    assert taken(outbox, 16 * MS) == [sent[1]]
    assert outbox.next_wake(16 * MS) == 17 * MS


def test_an_older_message_hastens_no_offer_of_the_newest() -> None:
    outbox = box()
    sent = put(outbox, 0)
    put(outbox, 0, cloud(8))
    taken(outbox, 15 * MS)
    ask(outbox, sent[0][0], (1, 2), 16 * MS)
    assert taken(outbox, 16 * MS) == sent[1:3]


def test_an_offer_waits_for_what_was_asked_for() -> None:
    outbox = box()
    sent = put(outbox, 0)
    outbox.pacer.window.window_bytes = 1  # full, so nothing goes again until there is a credit
    outbox.pacer.window.moved_nanos = 16 * MS
    ask(outbox, sent[0][0], (1, 2), 16 * MS)
    assert taken(outbox, 16 * MS) == []
    wake = outbox.next_wake(16 * MS)
    assert wake is not None
    assert wake > 16 * MS


def test_what_the_budget_does_not_hold_is_not_sent_again() -> None:
    outbox = Outbox(TO, 65_000, repair={(1, "/p"): Resend(5 * SECOND)})
    acknowledge(outbox, UNKNOWN_BUFFER)
    outbox.pacer.window.window_bytes = 10**9
    sent = put(outbox, 0, Message(1, "/p", "", 7, 0, bytes(1_500_000)))
    ask(outbox, sent[0][0], tuple(range(20)), MS)
    taken(outbox, MS)
    assert outbox.resender.resent == BURST_BYTES // 65_000
    assert outbox.resender.over_budget == 20 - outbox.resender.resent


@pytest.mark.parametrize("datagram", ["mtu", "loopback"])
def test_a_small_message_takes_its_own_size_of_the_budget(datagram: DatagramSize) -> None:
    outbox = Outbox(TO, datagram, repair={(2, "/p"): Resend(5 * SECOND)})
    acknowledge(outbox, UNKNOWN_BUFFER)
    outbox.pacer.window.window_bytes = 10**9
    for stamp in range(1000):
        put(outbox, 0, Message(2, "/p", "", stamp, 0, bytes(100)))
    for first in range(0, 1000, 50):
        header = Header(2, first, 0, 1, 0, 0, "/p")
        outbox.resender.asked(header, Request(2, 0, 50, 0), 0)
        taken(outbox, 0)
    assert (outbox.resender.resent, outbox.resender.over_budget) == (1000, 0)


def spent(budget: Budget, goodput: int, now: int, size: int = 1000) -> int:
    budget.told(goodput, now)
    count = 0
    while budget.spend(size, now):
        count += size
    return count


def test_in_the_long_run_a_quarter_of_the_goodput_is_sent_again() -> None:
    budget = Budget()
    goodput, count = 3_000_000, 0
    for tenth in range(400):
        now = tenth * SECOND // 10
        budget.left(400_000, now)
        came = spent(budget, goodput, now)
        count += came if tenth >= 200 else 0
    assert count == pytest.approx(20 * goodput / WINDOW_S, rel=0.01)


@pytest.mark.parametrize("left", [0, 500_000, 2_000_000])
def test_a_burst_is_mended_whatever_arrives_but_not_more_than_left(left: int) -> None:
    budget = Budget()
    budget.left(left, 0)
    most = max(LEAST_BYTES, min(left, BURST_BYTES))
    assert spent(budget, 0, 1) == most // 1000 * 1000
    assert spent(budget, 0, WINDOW_S * SECOND) == 0
    budget.left(left, WINDOW_S * SECOND)
    assert spent(budget, 0, WINDOW_S * SECOND + 1) == most // 1000 * 1000


def test_a_claim_beyond_what_was_sent_counts_for_nothing() -> None:
    budget = Budget()
    budget.left(20_000_000, 0)
    assert spent(budget, 1 << 31, 1) == 20_000_000 // WINDOW_S


def test_a_pause_starves_nobody() -> None:
    budget = Budget()
    budget.left(400_000_000, 0)
    assert spent(budget, 90_000_000, SECOND // 2, 10_000_000) == 90_000_000
    budget.left(10_000_000, 2 * SECOND)
    assert spent(budget, 9_500_000, 2 * SECOND) == 0  # still as much as the best second allows
    budget = Budget()
    budget.left(400_000_000, 0)
    budget.told(90_000_000, SECOND // 2)
    assert budget.spend(20_000_000, SECOND // 2)
    budget.left(10_000_000, 2 * SECOND)
    budget.told(9_500_000, 2 * SECOND)
    assert budget.spend(1_000_000, 2 * SECOND)
    # What was told so long ago as what was spent for it counts no more.
    now = SECOND // 2 + WINDOW_S * SECOND
    assert spent(budget, 1_500_000, now) == 10_000_000 // WINDOW_S - 1_000_000


def test_what_arrived_before_the_window_counts_no_more() -> None:
    budget, now = Budget(), WINDOW_S * SECOND
    budget.told(90_000_000, 0)
    budget.left(400_000_000, now)
    assert spent(budget, 0, now, 100_000) <= BURST_BYTES


def test_who_tells_ever_less_fills_no_memory() -> None:
    budget = Budget()
    for index in range(10_000):
        budget.told(10**6 - index, index * MS)
    assert len(budget._told) <= 10 * WINDOW_S + 1


def test_history_is_bounded() -> None:
    outbox = box()
    for stamp in range(HISTORY_MESSAGES + 10):
        put(outbox, 0, Message(2, "/p", "", stamp, 0, b"x"))
    assert outbox.resender.history_bytes == HISTORY_MESSAGES
    outbox = box()
    for stamp in range(12):
        outbox.put(Message(1, "/p", "", stamp, 0, bytes(16_000_000)))
        taken(outbox, 0)
    assert outbox.resender.history_bytes == 4 * 16_000_000


def offers(outbox: Outbox, until: int, step: int = MS // 2) -> list[tuple[int, Header, Offer]]:
    out = []
    for now in range(0, until, step):
        for header, body in taken(outbox, now):
            if header.msg_type == 65:
                offer = parse_resend(body)
                assert isinstance(offer, Offer)
                out.append((now // MS, header, offer))
    return out


def test_offers_follow_a_message_until_it_is_stale() -> None:
    outbox = box(limit=100 * MS)
    outbox.put(cloud())
    out = offers(outbox, 300 * MS)
    assert [when for when, _, _ in out] == [0, 1, 3, 7, 15, 31, 51, 71, 91]
    assert {offer for _, _, offer in out} == {Offer(1, 6, 100)}
    assert {header.stamp_nanos for _, header, _ in out} == {7}
    assert outbox.next_wake(300 * MS) is None


def test_an_offer_names_the_newest_message() -> None:
    outbox = box()
    put(outbox, 0)
    outbox.put(cloud(8))
    (_, header, _), *_ = offers(outbox, MS)
    assert (header.seq_number, header.stamp_nanos, header.link) == (1, 8, "")


def test_fast_topics_are_offered_at_most_every_5_ms() -> None:
    outbox = box()
    count = 0
    for now in range(0, SECOND, 2_500_000):
        outbox.put(Message(2, "/p", "", now, 0, b"x"))
        count += sum(header.msg_type == 65 for header, _ in taken(outbox, now))
    assert count == 200


def test_other_topics_are_not_kept_and_not_offered() -> None:
    outbox = box()
    outbox.put(Message(1, "/other", "", 1, 0, bytes(9000)))
    assert all(header.msg_type == 1 for header, _ in taken(outbox, 0))
    assert outbox.resender.history_bytes == 0
    assert outbox.next_wake(0) is None
