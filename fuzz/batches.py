# SPDX-License-Identifier: Apache-2.0
"""Fuzz batched receiving: batches of parts give the same as single datagrams.

`python -m fuzz.batches [--datagrams N] [--seconds S] [--seed N]` sends valid messages, mutations,
duplicates, losses and random bytes over real sockets, from two senders, to the receiving path of a
link, and passes the same datagrams one by one to a second inbox, and to a third one, which follows
no small topic. Messages, counts, reports and memory must be equal, and no body may change after its
delivery. A failure prints the seed that reproduces it.
"""

import random
import socket
import sys
from collections import Counter
from typing import Any

from udp_bridge import Limits, Message, fragments
from udp_bridge.io.native import batch_io
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.receiver.small_topics import SmallMessage, WholeMessage

from .reassembly import BATCH, message, mutated, run_batches

LIMITS = Limits(memory_bytes=1 << 19, senders=2, topics=4)
"""Small enough to be reached all the time; with two senders none is forgotten by chance."""
CHUNK = 40
"""Datagrams that arrive at one instant."""
PAUSES_NANOS = (0, 1000, 10**6, 10**8, 2 * 10**9)
SMALL = 10
"""Messages of a stream of small ones."""
CALM = 100
"""Messages of several parts that arrive before anything disturbs them."""
KEPT = 50
"""Delivered messages whose bodies are checked again later."""


class Inboxes:
    """An inbox that takes batches, two that take single datagrams, and two sending sockets."""

    def __init__(self) -> None:
        self.counts = Counter[str]()
        """`datagrams`, `in_slots`, `small`, `whole` and `messages`."""
        self._now_nanos = 0
        self._socket = UdpSocket(("127.0.0.1", 0), receive_buffer=8 << 20, wait_s=0.1)
        # Datagrams on loopback have arrived when they are sent: there is nothing to wait for.
        self._socket._socket.setblocking(False)
        self._senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for sender in self._senders:
            sender.bind(("127.0.0.1", 0))
        self._addresses = [sender.getsockname() for sender in self._senders]
        buffer = 1 << 16
        self._batched, self._single, self._plain = (
            Inbox(receive_buffer=buffer, on_credit=lambda *_: None, limits=LIMITS) for _ in range(3)
        )
        setattr(self._plain.small_topics, "follow", lambda *_: None)  # noqa: B010
        self._socket.use_small_topics(self._batched.small_topics)
        self._kept: list[tuple[Message, bytes]] = []

    def feed(self, chunk: list[tuple[bytes, int]], pause_nanos: int) -> None:
        """Pass datagrams to all; `AssertionError` when they do not agree."""
        self._now_nanos += pause_nanos
        for raw, sender in chunk:
            self._senders[sender].sendto(raw, self._socket.address)
        found = self._receive_batches(len(chunk))
        for inbox in (self._single, self._plain):
            expected = self._receive_singly(inbox, chunk)
            assert [(one[:5], bytes(one.body)) for one in found] == [
                (one[:5], bytes(one.body)) for one in expected
            ]
        self.counts.update(datagrams=len(chunk), messages=len(found))
        self._kept = [*self._kept, *((one, bytes(one.body)) for one in found)][-KEPT:]
        self._compare()
        assert self._batched.reassembler.memory_bytes <= LIMITS.memory_bytes
        assert all(one.body == body for one, body in self._kept)

    def end(self) -> None:
        """Close the sockets; nothing may stay held."""
        for inbox in (self._batched, self._single, self._plain):
            inbox.reassembler.give_up_all()
        self._compare()
        assert self._batched.reassembler.memory_bytes == 0
        for sender in self._senders:
            sender.close()
        self._socket.close()

    def _compare(self) -> None:
        expected = self._state(self._plain)
        assert self._state(self._batched) == expected
        assert self._state(self._single) == expected

    def _receive_batches(self, count: int) -> list[Message]:
        found = []
        delivered = self._batched.small_topics.delivered
        until = self._batched.datagrams + count
        while self._batched.datagrams < until:
            slots, credits = self._batched.predict_slots()
            batch = self._socket.receive_batch(slots, credits)
            assert batch is not None, "a datagram was lost on loopback"
            if isinstance(batch, SmallMessage):
                self.counts["small"] += 1
                self._batched.count_delivered()
                delivered[-1] = delivered[-1]._replace(now_nanos=self._now_nanos)
                found.append(batch.message)
                continue
            if isinstance(batch, WholeMessage):
                self.counts["whole"] += 1
                record = batch.delivered._replace(now_nanos=self._now_nanos)
                self._batched.take_whole(batch._replace(delivered=record))
                self._batched.follow_whole(slots, credits, batch)
                found.append(batch.message)
                continue
            self.counts["in_slots"] += batch.parts_count
            received = self._batched.receive_batch(slots, batch, self._now_nanos)
            found += [one for one, _, _ in received if one is not None]
        return found

    def _receive_singly(self, inbox: Inbox, chunk: list[tuple[bytes, int]]) -> list[Message]:
        received = [
            inbox.receive(memoryview(raw), self._addresses[sender], self._now_nanos)
            for raw, sender in chunk
        ]
        return [one for one, _ in received if one is not None]

    def _state(self, inbox: Inbox) -> dict[str, Any]:
        inbox.update_logs()
        reports = [inbox.reassembler.reports(sender, self._now_nanos) for sender in self._addresses]
        return {
            **inbox.reassembler.counters.as_dict(),
            "datagrams": inbox.datagrams,
            "bytes": inbox.bytes_received,
            "memory_bytes": inbox.reassembler.memory_bytes,
            "reports": reports,
        }


def stream(rng: random.Random, first: int) -> list[bytes]:
    """Return the datagrams of some valid messages of one topic, most of them of one size."""
    size, cut = rng.choice([9, 200, 2000, 9000, 30_000]), rng.choice([256, 300, 1472])
    found = []
    topics = rng.choice(["a", "b", "ab"])
    for seq in range(first, first + rng.randint(1, 4)):
        body = rng.randbytes(size if rng.random() < 0.8 else rng.randint(1, size))
        stamp_nanos = (seq - (rng.random() < 0.05)) % (1 << 30) * 10**9
        whole = Message(1, rng.choice(topics), "l", stamp_nanos, seq % (1 << 32), body)
        found += [head + bytes(part) for head, part in fragments(whole, cut)]
    return found


def calm_stream(rng: random.Random) -> list[bytes]:
    """Return the datagrams of messages of one size and topic, in order."""
    size = rng.choice([2000, 9000])
    whole = [Message(1, "d", "l", seq * 10**9, seq, rng.randbytes(size)) for seq in range(CALM)]
    return [head + bytes(part) for one in whole for head, part in fragments(one, 1472)]


def small_stream(rng: random.Random, first: int) -> list[bytes]:
    """Return the datagrams of messages of one part each, most of them with ascending stamps."""
    msg_type, link = rng.choice([1, 2]), rng.choice("lllm")
    found = []
    for seq in range(first, first + SMALL):
        stamp_nanos = (seq - (rng.random() < 0.05)) % (1 << 30) * 10**9
        whole = Message(msg_type, "c", link, stamp_nanos, seq % (1 << 32), rng.randbytes(9))
        found += [head + bytes(part) for head, part in fragments(whole)]
    return found


def repeated(rng: random.Random, datagrams: list[bytes]) -> list[bytes]:
    """Return them as they are, twice, or with some mutated or repeated ones before them."""
    kind = rng.random()
    if kind < 0.1:
        return datagrams + datagrams
    if kind < 0.2:
        first = [mutated(rng, rng.choice(datagrams)) for _ in range(3)]
        return first + datagrams
    if kind < 0.3:
        return rng.sample(datagrams, min(3, len(datagrams))) + datagrams
    return datagrams


def disturbed(rng: random.Random, datagrams: list[bytes], chaos: float) -> list[bytes]:
    """Return them with losses, duplicates, mutations, other messages, and some reordered."""
    keyed: list[tuple[float, bytes]] = []
    for index, raw in enumerate(datagrams):
        kind = rng.random() / chaos if chaos else 9.0
        if kind < 0.2:
            continue
        if kind < 0.4:
            keyed.append((index, rng.choice([mutated(rng, raw), raw + b"x"])))
        if kind < 0.5:
            keyed.append((index, rng.randbytes(rng.randrange(3000))))
        if kind < 0.6:
            keyed += [(index, other) for other in message(rng)[:3]]
        copies = 2 if 0.6 < kind < 0.8 else 1
        late = rng.random() * 30 if 0.8 < kind < 1 else 0
        keyed += [(index + late, raw)] * copies
    return [raw for _, raw in sorted(keyed, key=lambda row: row[0])]


def run_batch(seed: int) -> Counter[str]:
    """Feed one batch to new inboxes; return the counts."""
    rng = random.Random(seed)
    inboxes = Inboxes()
    first, small = 0, rng.choice([0, (1 << 32) - 55])
    calm = [(raw, 0) for raw in calm_stream(rng)]
    for begin in range(0, len(calm), CHUNK):
        inboxes.feed(calm[begin : begin + CHUNK], rng.choice(PAUSES_NANOS))
    while inboxes.counts["datagrams"] < BATCH:
        is_small = rng.random() < 0.3
        whole = small_stream(rng, small) if is_small else repeated(rng, stream(rng, first))
        small += SMALL * is_small
        cut = disturbed(rng, whole, rng.choice([0, 0, 0, 0, 0.03, 0.3, 1]))
        first += -3 if first > 3 and rng.random() < 0.03 else rng.choice([1, 2, 4, 4, 4])
        if rng.random() < 0.05:  # farther ahead or behind than networks reorder
            first = max(0, first + rng.choice([2990, 5000, -150, 1 << 30])) % (1 << 32)
        if rng.random() < 0.05:  # a restart after a silence
            first = rng.randrange(4)
            inboxes.feed([], PAUSES_NANOS[-1])
        other = rng.random() < 0.2
        rows = [(raw, int(rng.random() < 0.5 if other else other)) for raw in cut]
        for begin in range(0, len(rows), CHUNK):
            inboxes.feed(rows[begin : begin + CHUNK], rng.choice(PAUSES_NANOS[: 5 if other else 3]))
    inboxes.end()
    return inboxes.counts


def main() -> int:
    """Run batches until there were enough datagrams or the time is over."""
    counts, summary = run_batches("fuzz.batches", run_batch)
    how = "many at a time" if batch_io else "one at a time"
    print(
        f"{summary}; received {how}, {counts['in_slots']} in their slots, {counts['whole']} whole"
        " messages; equal to single datagrams, nothing raised, limits held"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
