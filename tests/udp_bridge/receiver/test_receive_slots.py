# SPDX-License-Identifier: Apache-2.0
"""Whatever comes, and wherever it lands: the outcome is that of taking each datagram by itself."""

from __future__ import annotations

import random
from typing import Any

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


class Kernel:
    """Puts datagrams where they are expected, as a socket would; never more than `most` at once."""

    def __init__(self, datagrams: list[Datagram]) -> None:
        self.left = list(datagrams)

    def receive(self, place: ReceiveSlots, credits: CreditState, most: int) -> PartBatch:
        head, last_size = b"", place.part_size
        rows: list[tuple[int, int]] = []
        uncredited = credits.uncredited_bytes
        arrived = bytearray(place.arrived)
        place = place._replace(arrived=arrived)
        while self.left and len(rows) < most and 0 in arrived:
            raw, sender = self.left[0]
            own = raw[: len(place.header)]
            if len(raw) <= len(own) or not place.matches(own, len(raw), sender):
                break
            del self.left[0]
            body, number = raw[len(own) :], own[6]
            for where in (place.next_part, number):  # it is received where another one is expected
                start = where * place.part_size
                with memoryview(place.block) as view:
                    view[start : start + len(body)] = body
            head = head or own
            rows.append((number, 1))
            arrived[number] = 1
            if number == len(arrived) - 1:
                last_size = len(body)
            uncredited += len(raw)
            after = arrived.find(0, max(number, place.next_part))
            upcoming = after if after >= 0 else arrived.find(0)
            place = place._replace(next_part=upcoming, header=own, is_open=True)
        if not self.left or (rows and (len(rows) >= most or 0 not in arrived)):
            return PartBatch(head, tuple(rows), last_size, 0, uncredited, None, None)
        raw, sender = self.left.pop(0)
        if 0 in arrived:  # it was received into a place that is not its own
            start = place.next_part * place.part_size
            with memoryview(place.block) as view:
                spoilt = raw[len(place.header) :][: place.part_size]
                view[start : start + len(spoilt)] = spoilt
        return PartBatch(head, tuple(rows), last_size, 0, uncredited, raw, sender)


def outcome(inbox: Inbox, messages: list[Any]) -> dict[str, Any]:
    return {
        "messages": [(m.topic, m.seq_number, bytes(m.body), who) for m, who in messages],
        "counters": inbox.reassembler.counters.as_dict(),
        "datagrams": inbox.datagrams,
        "bytes": inbox.bytes_received,
        "memory": inbox.reassembler.memory_bytes,
    }


def by_itself(datagrams: list[Datagram]) -> dict[str, Any]:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    messages = []
    for now, (raw, sender) in enumerate(datagrams):
        message, _ = inbox.receive(memoryview(raw), sender, now)
        if message is not None:
            messages.append((message, sender))
    return outcome(inbox, messages)


def in_runs(datagrams: list[Datagram], rng: random.Random) -> tuple[dict[str, Any], int]:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    kernel = Kernel(datagrams)
    messages: list[Any] = []
    runs = 0
    while kernel.left:
        now = len(datagrams) - len(kernel.left)
        place, credits = inbox.predict_slots()
        run = kernel.receive(place, credits, rng.randint(1, 20))
        taken = inbox.receive_batch(place, run, now)
        runs += run.parts_count > 1
        messages += [(message, sender) for message, _, sender in taken if message is not None]
    return outcome(inbox, messages), runs


def disorder(seed: int, chaos: float) -> list[Datagram]:
    """Return the datagrams of some messages, mixed, with copies, losses, garbage."""
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
    for place, (raw, sender) in enumerate(datagrams):
        if rng.random() < chaos / 4:
            continue
        if rng.random() < chaos / 4:
            raw = raw[: rng.randrange(len(raw))] + bytes([rng.randrange(256)])
        for _ in range(1 + (rng.random() < chaos / 4)):
            keyed.append((place + rng.random() * 40 * chaos * (rng.random() < chaos), raw, sender))
    return [(raw, sender) for _, raw, sender in sorted(keyed, key=lambda row: row[0])]


@settings(max_examples=150)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1, 0.4, 1.0]))
def test_runs_give_what_single_datagrams_give(seed: int, chaos: float) -> None:
    datagrams = disorder(seed, chaos)
    found, _ = in_runs(datagrams, random.Random(seed))
    assert found == by_itself(datagrams)


def test_in_order_a_message_is_one_run() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    for seq in range(3):
        body = random.Random(seq).randbytes(9000)
        message = Message(1, "/points", "lidar", 10**9 + seq, seq, body)
        kernel = Kernel([(h + bytes(part), SENDERS[0]) for h, part in fragments(message, 300)])
        messages = []
        turns = 0
        while kernel.left:
            place, credits = inbox.predict_slots()
            run = kernel.receive(place, credits, 255)
            messages += [one for one, _, _ in inbox.receive_batch(place, run, 0) if one is not None]
            turns += 1
        assert [bytes(one.body) for one in messages] == [body]
        assert turns == (2 if seq == 0 else 1)  # of the first one the first part is unexpected


def test_a_message_that_was_handed_over_is_never_written_to() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    kept = []
    for seq in range(20):
        body = random.Random(seq).randbytes(5000)
        message = Message(1, "/points", "lidar", 10**9 + seq, seq, body)
        kernel = Kernel([(h + bytes(part), SENDERS[0]) for h, part in fragments(message, 300)])
        while kernel.left:
            place, credits = inbox.predict_slots()
            run = kernel.receive(place, credits, 255)
            kept += [(m, seq) for m, _, _ in inbox.receive_batch(place, run, 0) if m is not None]
    assert len(kept) == 20
    for received, seq in kept:
        assert received.body == random.Random(seq).randbytes(5000)


def run_of(inbox: Inbox, datagrams: list[Datagram], now: int = 0) -> list[Any]:
    kernel = Kernel(datagrams)
    taken: list[Any] = []
    while kernel.left:
        place, credits = inbox.predict_slots()
        taken += inbox.receive_batch(place, kernel.receive(place, credits, 255), now)
    return taken


def cut(seq: int, size: int = 5000, topic: str = "/points") -> list[Datagram]:
    message = Message(1, topic, "lidar", 10**9 + seq, seq, random.Random(seq).randbytes(size))
    return [(head + bytes(part), SENDERS[0]) for head, part in fragments(message, 300)]


def test_parts_of_a_message_that_was_given_up_are_copies() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, cut(0)[:5])
    inbox.reassembler.expire(3 * 10**9)
    assert inbox.reassembler.counters.incomplete == 1
    run_of(inbox, cut(0)[5:], 3 * 10**9)
    assert inbox.reassembler.counters.duplicates == len(cut(0)) - 5
    messages = [one for one, _, _ in run_of(inbox, cut(1), 3 * 10**9) if one is not None]
    assert [message.seq_number for message in messages] == [1]


def test_a_message_that_announces_too_much_is_given_up_in_a_run_too() -> None:
    limits = Limits(memory_bytes=1 << 16, share=4)
    outcomes = []
    for take in (run_of, one_by_one):
        inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None, limits=limits)
        take(inbox, cut(0) + cut(1, 20_000) + cut(2))
        outcomes.append((inbox.reassembler.counters.as_dict(), inbox.reassembler.memory_bytes))
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][0]["incomplete"] == 1
    assert outcomes[0][0]["duplicates"] > 10


def one_by_one(inbox: Inbox, datagrams: list[Datagram]) -> None:
    for raw, sender in datagrams:
        inbox.receive(memoryview(raw), sender, 0)


def test_credits_that_went_out_beside_a_run_are_not_sent_again() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, cut(0))
    place, credits = inbox.predict_slots()
    run = Kernel(cut(1)).receive(place, credits, 255)
    credited = run._replace(credits_sent=2, uncredited_bytes=0)
    ((message, answer, _),) = inbox.receive_batch(place, credited, 0)
    assert message is not None
    assert answer is None
    assert (inbox.socket_answers, inbox.socket_answer_bytes) == (2, 2 * (28 + 12))
    assert inbox.predict_slots()[1] == CreditState(0, 1 << 16, credits.seq_number + 2)


def test_parts_are_not_waited_for_when_others_are_to_be_asked_for() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, cut(0)[:3])
    assert inbox.predict_slots()[0].nack_due_nanos == 0
    offer = Message(65, "/points", "", 10**9, 0, Offer(1, len(cut(0)), 500).pack())
    run_of(inbox, [(head + bytes(part), SENDERS[0]) for head, part in fragments(offer)])
    inbox.requests(0)
    run_of(inbox, cut(0)[4:6])
    assert inbox.predict_slots()[0].nack_due_nanos > 0


def offered_inbox() -> Inbox:
    """Return one to which a topic was offered, and of which nothing is missing."""
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, cut(0))
    offer = Message(65, "/points", "", 10**9, 0, Offer(1, len(cut(0)), 500).pack())
    run_of(inbox, [(head + bytes(part), SENDERS[0]) for head, part in fragments(offer)])
    run_of(inbox, cut(1)[:5])
    run_of(inbox, cut(1)[5:])
    return inbox


def test_what_was_asked_for_in_a_run_is_not_asked_for_again_before_its_time() -> None:
    inbox = offered_inbox()
    datagrams = cut(2)
    place, credits = inbox.predict_slots()
    assert place.may_nack
    run = Kernel([*datagrams[:2], *datagrams[3:]]).receive(place, credits, 255)
    inbox.receive_batch(place, run._replace(nack_bitmap=b"\4\0", nack_nanos=5), 10)
    assert inbox.requests(10) == []
    assert inbox.requests_sent == 1
    assert inbox.socket_answer_bytes == 28 + 8 + 2
    place, _ = inbox.predict_slots()
    assert not place.may_nack
    assert place.nack_due_nanos == 5 + FIRST_WAIT_NANOS
    ((message, _, _),) = run_of(inbox, datagrams[2:3], 1000)
    assert message is not None
    assert inbox.reassembler.counters.repaired == 1
    place, _ = inbox.predict_slots()
    assert (place.may_nack, place.nack_due_nanos) == (True, 0)
    assert place.debounce_nanos == (1000 - 5) // 4  # it was a round trip


def test_what_was_asked_for_in_a_run_may_come_in_it() -> None:
    inbox = offered_inbox()
    datagrams = cut(2)
    place, credits = inbox.predict_slots()
    run = Kernel([*datagrams[:2], *datagrams[3:], datagrams[2]]).receive(place, credits, 255)
    asked = run._replace(nack_bitmap=b"\4\0", nack_nanos=5)
    ((message, _, _),) = inbox.receive_batch(place, asked, 10)
    assert message is not None
    assert inbox.reassembler.counters.repaired == 1
    assert inbox.requests(10**9) == []
    assert inbox.predict_slots()[0].may_nack


def test_for_copies_of_what_was_handed_over_nothing_is_asked_again() -> None:
    inbox = offered_inbox()
    place, credits = inbox.predict_slots()
    datagrams = cut(1)
    run = Kernel([*datagrams[:2], *datagrams[3:]]).receive(place, credits, 255)
    inbox.receive_batch(place, run._replace(nack_bitmap=b"\4\0", nack_nanos=5), 10)
    run_of(inbox, cut(2), 10**8)
    assert inbox.requests(10**8) == []
    assert inbox.predict_slots()[0].may_nack


def test_behind_a_part_that_is_sent_again_the_message_goes_on_where_it_was() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, [*cut(0)[:1], *cut(0)[2:3], *cut(0)[4:5], *cut(0)[1:2]])
    assert inbox.predict_slots()[0].next_part == 5
    run_of(inbox, cut(0)[5:])
    assert inbox.predict_slots()[0].next_part == 3


def test_a_run_that_contradicts_its_message_is_refused_and_not_followed() -> None:
    raw, sender = cut(1)[2]
    wrong = raw[:7] + bytes([raw[7] - 5]) + raw[8:]
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    for datagrams in (cut(0), [(wrong, sender)], cut(2), cut(1)[:7], cut(1)[7:]):
        run_of(inbox, datagrams)
    assert inbox.reassembler.counters.refused == {"parts_max": len(cut(1))}
    assert not inbox.predict_slots()[0].is_open


def test_a_run_after_a_silence_shows_a_restarted_sender() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    run_of(inbox, cut(5))
    taken = run_of(inbox, cut(3), 2 * 10**9)
    assert [one.seq_number for one, _, _ in taken if one is not None] == [3]
    assert inbox.reassembler.counters.late == 0


def test_a_run_of_a_message_that_was_handed_over_is_copies() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    for seq in (0, 1, 1):
        run_of(inbox, cut(seq))
    counters = inbox.reassembler.counters
    assert (counters.messages, counters.duplicates) == (2, len(cut(1)))
    assert inbox.reassembler.memory_bytes == 0
