# SPDX-License-Identifier: Apache-2.0
"""Whatever comes, and wherever it lands: the outcome is that of taking each datagram by itself."""

from __future__ import annotations

import random
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from udp_bridge import Message, fragments
from udp_bridge.placing import Slots
from udp_bridge.receiving import Inbox

SENDERS = (("192.0.2.7", 5000), ("192.0.2.8", 5000))
Datagram = tuple[bytes, tuple[str, int]]


class FakeRun:
    """Datagrams scattered into slots as a kernel would."""

    def __init__(self, slots: Slots, datagrams: list[Datagram]) -> None:
        self.slots = slots
        self.count = len(datagrams)
        self._datagrams = datagrams
        self._rest = []
        for index, (raw, _) in enumerate(datagrams):
            body = raw[slots.header_size :]
            start = (slots.first + index) * slots.part_size
            placed = body[: slots.part_size]
            with memoryview(slots.block) as view:
                view[start : start + len(placed)] = placed
            self._rest.append(body[slots.part_size :])

    def size(self, index: int) -> int:
        return len(self._datagrams[index][0])

    def head(self, index: int) -> bytes:
        return self._datagrams[index][0][: self.slots.header_size]

    def sender(self, index: int) -> tuple[str, int]:
        return self._datagrams[index][1]

    def follows(self, index: int, heads: bytes, sizes: list[int]) -> bool:
        rest = range(index, self.count)
        near = range(max(0, index - 1), self.count)
        return (
            b"".join(self.head(i) for i in rest) == heads
            and [self.size(i) for i in rest] == sizes
            and len({self.sender(i) for i in near}) == 1
        )

    def copy(self, index: int) -> bytes:
        start = (self.slots.first + index) * self.slots.part_size
        size = max(0, self.size(index) - self.slots.header_size)
        placed = bytes(self.slots.block[start : start + min(size, self.slots.part_size)])
        return self.head(index) + placed + self._rest[index]


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
        message, _ = inbox.receive(memoryview(raw), sender, now, 0)
        if message is not None:
            messages.append((message, sender))
    return outcome(inbox, messages)


def in_runs(datagrams: list[Datagram], rng: random.Random) -> tuple[dict[str, Any], int]:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    messages: list[Any] = []
    runs = index = 0
    while index < len(datagrams):
        slots = inbox.slots()
        if slots is None:
            raw, sender = datagrams[index]
            message, _ = inbox.receive(memoryview(raw), sender, index, 0)
            taken = [(message, None, sender)]
            index += 1
        else:
            count = rng.randint(1, slots.slot_count)
            run = FakeRun(slots, datagrams[index : index + count])
            taken = inbox.receive_run(run, index)
            index += run.count
            runs += 1
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


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1, 0.4, 1.0]))
def test_runs_give_what_single_datagrams_give(seed: int, chaos: float) -> None:
    datagrams = disorder(seed, chaos)
    found, _ = in_runs(datagrams, random.Random(seed))
    assert found == by_itself(datagrams)


def test_in_order_all_but_the_first_parts_are_placed_in_one_block() -> None:
    message = Message(1, "/points", "lidar", 10**9, 0, random.Random(1).randbytes(9000))
    datagrams = [(head + bytes(part), SENDERS[0]) for head, part in fragments(message, 300)]
    found, runs = in_runs(datagrams, random.Random(1))
    assert found["messages"] == [("/points", 0, message.body, SENDERS[0])]
    assert runs < len(datagrams)


def test_a_message_that_was_handed_over_is_never_written_to() -> None:
    inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None)
    kept = []
    for seq in range(20):
        body = random.Random(seq).randbytes(5000)
        message = Message(1, "/points", "lidar", 10**9 + seq, seq, body)
        datagrams = [(head + bytes(part), SENDERS[0]) for head, part in fragments(message, 300)]
        while datagrams:
            slots = inbox.slots()
            if slots is None:
                raw, sender = datagrams.pop(0)
                inbox.receive(memoryview(raw), sender, 0, 0)
                continue
            run = FakeRun(slots, datagrams[: slots.slot_count])
            del datagrams[: run.count]
            kept += [(m, seq) for m, _, _ in inbox.receive_run(run, 0) if m is not None]
    assert len(kept) == 20
    for received, seq in kept:
        assert received.body == random.Random(seq).randbytes(5000)
