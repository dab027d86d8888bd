# SPDX-License-Identifier: Apache-2.0
"""Batches of parts give the same messages, counts and memory as single datagrams."""

import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from udp_bridge import Message, fragments
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.receiver.limits import Limits
from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.receiver.round_trip import FIRST_WAIT_NANOS
from udp_bridge.wire.repair import Offer

SENDERS = (("192.0.2.7", 5000), ("192.0.2.8", 5000))
Datagram = tuple[bytes, tuple[str, int]]
Received = tuple[Message | None, Any, Any]
"""A message, if one is complete, the answer to its sender, and the sender."""


class Kernel:
    """Receives datagrams into their slots like a socket, at most `limit` parts per batch."""

    def __init__(self, datagrams: list[Datagram]) -> None:
        self.left = list(datagrams)

    def receive(self, slots: ReceiveSlots, credits: CreditState, limit: int) -> PartBatch:
        head, last_size = b"", slots.part_size
        ranges: list[tuple[int, int]] = []
        uncredited = credits.uncredited_bytes
        arrived = bytearray(slots.arrived)
        slots = slots._replace(arrived=arrived)
        while self.left and len(ranges) < limit and 0 in arrived:
            raw, sender = self.left[0]
            own = raw[: len(slots.header)]
            if len(raw) <= len(own) or not slots.matches(own, len(raw), sender):
                break
            del self.left[0]
            body, number = raw[len(own) :], own[6]
            for where in (slots.next_part, number):  # it is received where another one is expected
                start = where * slots.part_size
                with memoryview(slots.block) as view:
                    view[start : start + len(body)] = body
            head = head or own
            ranges.append((number, 1))
            arrived[number] = 1
            if number == len(arrived) - 1:
                last_size = len(body)
            uncredited += len(raw)
            after = arrived.find(0, max(number, slots.next_part))
            next_part = after if after >= 0 else arrived.find(0)
            slots = slots._replace(next_part=next_part, header=own, is_open=True)
        if not self.left or (ranges and (len(ranges) >= limit or 0 not in arrived)):
            return PartBatch(head, tuple(ranges), last_size, 0, uncredited, None, None)
        raw, sender = self.left.pop(0)
        if 0 in arrived:  # it was received into a slots that is not its own
            start = slots.next_part * slots.part_size
            with memoryview(slots.block) as view:
                overwritten = raw[len(slots.header) :][: slots.part_size]
                view[start : start + len(overwritten)] = overwritten
        return PartBatch(head, tuple(ranges), last_size, 0, uncredited, raw, sender)


def outcome(take: Callable[..., list[Received]], *arguments: Any) -> dict[str, Any]:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    received = take(inbox, *arguments)
    return {
        "messages": [(m.topic, m.seq_number, bytes(m.body), who) for m, _, who in received if m],
        "counters": inbox.reassembler.counters.as_dict(),
        "datagrams": inbox.datagrams,
        "bytes": inbox.bytes_received,
        "memory": inbox.reassembler.memory_bytes,
    }


def one_by_one(inbox: Inbox, datagrams: list[Datagram]) -> list[Received]:
    return [
        (*inbox.receive(memoryview(raw), sender, now), sender)
        for now, (raw, sender) in enumerate(datagrams)
    ]


def receive_batches(
    inbox: Inbox, datagrams: list[Datagram], now: int = 0, rng: random.Random | None = None
) -> list[Received]:
    """Receive in batches, of random lengths if there is a generator."""
    kernel = Kernel(datagrams)
    received: list[Received] = []
    while kernel.left:
        slots, credits = inbox.predict_slots()
        batch = kernel.receive(slots, credits, rng.randint(1, 20) if rng else 255)
        received += inbox.receive_batch(slots, batch, now)
    return received


def numbers(received: list[Received]) -> list[int]:
    return [message.seq_number for message, _, _ in received if message is not None]


def cut(seq: int, size: int = 5000, topic: str = "/points") -> list[Datagram]:
    message = Message(1, topic, "lidar", 10**9 + seq, seq, random.Random(seq).randbytes(size))
    return [(head + bytes(part), SENDERS[0]) for head, part in fragments(message, 300)]


def offer_of(datagrams: list[Datagram]) -> list[Datagram]:
    offer = Message(65, "/points", "", 10**9, 0, Offer(1, len(datagrams), 500).pack())
    return [(head + bytes(part), SENDERS[0]) for head, part in fragments(offer)]


@pytest.fixture
def inbox() -> Inbox:
    return Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)


def disorder(seed: int, chaos: float) -> list[Datagram]:
    """Return the datagrams of some messages with duplicates, losses, reordering and garbage."""
    rng = random.Random(seed)
    datagrams: list[Datagram] = []
    for seq in range(8):
        sender = SENDERS[rng.random() < 0.2]
        topic = rng.choice(["/points", "/points", "/image"])
        body = rng.randbytes(rng.choice([1, 230, 2300, 4321, 9000]))
        message = Message(1, topic, "lidar", 10**9 + seq, seq, body)
        size = rng.choice([280, 280, 300])
        datagrams += [(head + bytes(part), sender) for head, part in fragments(message, size)]
    keyed = []
    for slots, (raw, sender) in enumerate(datagrams):
        if rng.random() < chaos / 4:
            continue
        if rng.random() < chaos / 4:
            raw = raw[: rng.randrange(len(raw))] + bytes([rng.randrange(256)])
        for _ in range(1 + (rng.random() < chaos / 4)):
            keyed.append((slots + rng.random() * 40 * chaos * (rng.random() < chaos), raw, sender))
    return [(raw, sender) for _, raw, sender in sorted(keyed, key=lambda row: row[0])]


@settings(max_examples=150)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1, 0.4, 1.0]))
def test_batches_give_what_single_datagrams_give(seed: int, chaos: float) -> None:
    datagrams = disorder(seed, chaos)
    batched = outcome(receive_batches, datagrams, 0, random.Random(seed))
    assert batched == outcome(one_by_one, datagrams)


def test_in_order_a_message_is_one_batch(inbox: Inbox) -> None:
    for seq in range(3):
        received = receive_batches(inbox, cut(seq, 9000))
        bodies = [bytes(message.body) for message, _, _ in received if message is not None]
        assert bodies == [random.Random(seq).randbytes(9000)]
        # Of the first one the first part is alone. The last row has a Credit.
        assert len(received) == (3 if seq == 0 else 2)
        assert [answer is not None for _, answer, _ in received][-2:] == [False, True]


def test_a_delivered_message_is_never_overwritten(inbox: Inbox) -> None:
    received = [row for seq in range(20) for row in receive_batches(inbox, cut(seq))]
    kept = [message for message, _, _ in received if message is not None]
    assert len(kept) == 20
    for message in kept:
        assert message.body == random.Random(message.seq_number).randbytes(5000)


def test_parts_of_a_message_that_was_given_up_are_duplicates(inbox: Inbox) -> None:
    receive_batches(inbox, cut(0)[:5])
    inbox.reassembler.expire(3 * 10**9)
    assert inbox.reassembler.counters.incomplete == 1
    receive_batches(inbox, cut(0)[5:], 3 * 10**9)
    assert inbox.reassembler.counters.duplicates == len(cut(0)) - 5
    assert numbers(receive_batches(inbox, cut(1), 3 * 10**9)) == [1]


def test_a_message_that_announces_too_much_is_given_up_in_a_batch_too() -> None:
    limits = Limits(memory_bytes=1 << 16, share=4)
    outcomes = []
    for take in (receive_batches, one_by_one):
        inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None, limits=limits)
        take(inbox, cut(0) + cut(1, 20_000) + cut(2))
        outcomes.append((inbox.reassembler.counters.as_dict(), inbox.reassembler.memory_bytes))
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][0]["incomplete"] == 1
    assert outcomes[0][0]["duplicates"] > 10


def test_credits_that_the_socket_sent_are_not_sent_again(inbox: Inbox) -> None:
    receive_batches(inbox, cut(0))
    slots, credits = inbox.predict_slots()
    batch = Kernel(cut(1)).receive(slots, credits, 255)
    credited = batch._replace(credits_sent=2, uncredited_bytes=0)
    ((message, answer, _),) = inbox.receive_batch(slots, credited, 0)
    assert message is not None
    assert answer is None
    assert (inbox.socket_answers, inbox.socket_answer_bytes) == (2, 2 * (28 + 12))
    assert inbox.predict_slots()[1] == CreditState(0, 1 << 16, credits.seq_number + 2)


def test_a_batch_ends_when_a_request_is_due(inbox: Inbox) -> None:
    receive_batches(inbox, cut(0)[:3])
    assert inbox.predict_slots()[0].nack_due_nanos == 0
    receive_batches(inbox, offer_of(cut(0)))
    inbox.requests(0)
    receive_batches(inbox, cut(0)[4:6])
    assert inbox.predict_slots()[0].nack_due_nanos > 0


@pytest.fixture
def offered(inbox: Inbox) -> None:
    """The inbox has an offered topic of which nothing is missing."""
    receive_batches(inbox, cut(0))
    receive_batches(inbox, offer_of(cut(0)))
    receive_batches(inbox, cut(1)[:5])
    receive_batches(inbox, cut(1)[5:])


def test_what_the_socket_requested_is_not_requested_again_too_early(
    inbox: Inbox, offered: None
) -> None:
    datagrams = cut(2)
    slots, credits = inbox.predict_slots()
    assert slots.may_nack
    batch = Kernel([*datagrams[:2], *datagrams[3:]]).receive(slots, credits, 255)
    list(inbox.receive_batch(slots, batch._replace(nack_bitmap=b"\4\0", nack_nanos=5), 10))
    assert inbox.requests(10) == []
    assert inbox.requests_sent == 1
    assert inbox.socket_answer_bytes == 28 + 8 + 2
    slots, _ = inbox.predict_slots()
    assert not slots.may_nack
    assert slots.nack_due_nanos == 5 + FIRST_WAIT_NANOS
    (message, _, _), *_ = receive_batches(inbox, datagrams[2:3], 1000)
    assert message is not None
    assert inbox.reassembler.counters.repaired == 1
    slots, _ = inbox.predict_slots()
    assert (slots.may_nack, slots.nack_due_nanos) == (True, 0)
    assert slots.debounce_nanos == (1000 - 5) // 4  # it was a round trip


def test_what_the_socket_requested_may_arrive_in_the_same_batch(
    inbox: Inbox, offered: None
) -> None:
    datagrams = cut(2)
    slots, credits = inbox.predict_slots()
    batch = Kernel([*datagrams[:2], *datagrams[3:], datagrams[2]]).receive(slots, credits, 255)
    requested = batch._replace(nack_bitmap=b"\4\0", nack_nanos=5)
    (message, _, _), *_ = inbox.receive_batch(slots, requested, 10)
    assert message is not None
    assert inbox.reassembler.counters.repaired == 1
    assert inbox.requests(10**9) == []
    assert inbox.predict_slots()[0].may_nack


def test_nothing_is_requested_for_duplicates_of_a_delivered_message(
    inbox: Inbox, offered: None
) -> None:
    slots, credits = inbox.predict_slots()
    datagrams = cut(1)
    batch = Kernel([*datagrams[:2], *datagrams[3:]]).receive(slots, credits, 255)
    list(inbox.receive_batch(slots, batch._replace(nack_bitmap=b"\4\0", nack_nanos=5), 10))
    receive_batches(inbox, cut(2), 10**8)
    assert inbox.requests(10**8) == []
    assert inbox.predict_slots()[0].may_nack


def test_a_resent_part_does_not_set_the_prediction_back(inbox: Inbox) -> None:
    receive_batches(inbox, [*cut(0)[:1], *cut(0)[2:3], *cut(0)[4:5], *cut(0)[1:2]])
    assert inbox.predict_slots()[0].next_part == 5
    receive_batches(inbox, cut(0)[5:])
    assert inbox.predict_slots()[0].next_part == 3


def test_a_batch_that_contradicts_its_message_is_refused_and_not_followed(inbox: Inbox) -> None:
    raw, sender = cut(1)[2]
    wrong = raw[:7] + bytes([raw[7] - 5]) + raw[8:]
    for datagrams in (cut(0), [(wrong, sender)], cut(2), cut(1)[:7], cut(1)[7:]):
        receive_batches(inbox, datagrams)
    assert inbox.reassembler.counters.refused == {"parts_max": len(cut(1))}
    assert not inbox.predict_slots()[0].is_open


def test_a_batch_after_a_silence_shows_a_restarted_sender(inbox: Inbox) -> None:
    receive_batches(inbox, cut(5))
    assert numbers(receive_batches(inbox, cut(3), 2 * 10**9)) == [3]
    assert inbox.reassembler.counters.late == 0


def test_a_batch_of_a_delivered_message_is_duplicates(inbox: Inbox) -> None:
    for seq in (0, 1, 1):
        receive_batches(inbox, cut(seq))
    counters = inbox.reassembler.counters
    assert (counters.messages, counters.duplicates) == (2, len(cut(1)))
    assert inbox.reassembler.memory_bytes == 0
