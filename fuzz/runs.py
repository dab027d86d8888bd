# SPDX-License-Identifier: Apache-2.0
"""Whatever arrives, parts received in runs into their places give what single datagrams give.

`python -m fuzz.runs [--datagrams N] [--seconds S] [--seed N]` sends honest messages, mutations,
copies, losses and random bytes over real sockets, from two senders, to the receiving path of a
link, and gives the same datagrams to a second receiver one by one. What both hand over, count and
hold must be equal, and no body may change once it was handed over. A failure prints its seed.
"""

from __future__ import annotations

import argparse
import random
import socket
import sys
import time
from typing import Any

from udp_bridge import Limits, Message, fragments
from udp_bridge.io.batch_io import IS_BUILT
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.receiver.inbox import Inbox

from .reassembly import message, mutated, peak_mb

LIMITS = Limits(memory_bytes=1 << 19, senders=2, topics=4)
"""Small enough that limits are met all the time; with two senders none is forgotten by chance."""
BATCH = 20_000
CHUNK = 40
"""Datagrams that arrive at one instant."""
PAUSES_NANOS = (0, 1000, 10**6, 10**8, 2 * 10**9)
KEPT = 50
"""Messages whose bodies are looked at again later."""


class Pair:
    """A receiver of runs, one of single datagrams, and two sockets that send to the first."""

    def __init__(self) -> None:
        self.datagrams = 0
        self.in_runs = 0
        self.messages = 0
        self._now_nanos = 0
        self._socket = UdpSocket(("127.0.0.1", 0), receive_buffer=8 << 20, wait_s=0.1)
        # On loopback what was sent lies there already: what is not there need not be waited for.
        self._socket._socket.setblocking(False)
        self._senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for sender in self._senders:
            sender.bind(("127.0.0.1", 0))
        self._addresses = [sender.getsockname() for sender in self._senders]
        buffer = 1 << 16
        self._runs, self._singles = (
            Inbox(receive_buffer=buffer, on_credit=lambda *_: None, limits=LIMITS) for _ in range(2)
        )
        self._kept: list[tuple[Message, bytes]] = []

    def feed(self, chunk: list[tuple[bytes, int]], pause_nanos: int) -> None:
        """Let datagrams arrive; `AssertionError` when the two receivers do not agree."""
        self._now_nanos += pause_nanos
        for raw, sender in chunk:
            self._senders[sender].sendto(raw, self._socket.address)
        found, expected = self._by_runs(len(chunk)), self._one_by_one(chunk)
        assert [(one[:5], bytes(one.body)) for one in found] == [
            (one[:5], bytes(one.body)) for one in expected
        ]
        self.datagrams += len(chunk)
        self.messages += len(found)
        self._kept = [*self._kept, *((one, bytes(one.body)) for one in found)][-KEPT:]
        assert _state(self._runs) == _state(self._singles)
        assert self._runs.reassembler.memory_bytes <= LIMITS.memory_bytes
        assert all(one.body == body for one, body in self._kept)

    def end(self) -> None:
        """Give the sockets back; at the end nothing may be held."""
        for inbox in (self._runs, self._singles):
            inbox.reassembler.give_up_all()
        assert _state(self._runs) == _state(self._singles)
        assert self._runs.reassembler.memory_bytes == 0
        for sender in self._senders:
            sender.close()
        self._socket.close()

    def _by_runs(self, count: int) -> list[Message]:
        found = []
        until = self._runs.datagrams + count
        while self._runs.datagrams < until:
            place, credits = self._runs.predict_slots()
            run = self._socket.receive_run(place, credits)
            assert run is not None, "a datagram was lost on loopback"
            self.in_runs += run.parts_count
            taken = self._runs.receive_batch(place, run, self._now_nanos)
            found += [one for one, _, _ in taken if one is not None]
        return found

    def _one_by_one(self, chunk: list[tuple[bytes, int]]) -> list[Message]:
        found = []
        for raw, sender in chunk:
            address = self._addresses[sender]
            one, _ = self._singles.receive(memoryview(raw), address, self._now_nanos)
            if one is not None:
                found.append(one)
        return found


def _state(inbox: Inbox) -> dict[str, Any]:
    return {
        **inbox.reassembler.counters.as_dict(),
        "datagrams": inbox.datagrams,
        "bytes": inbox.bytes_received,
        "memory_bytes": inbox.reassembler.memory_bytes,
    }


def stream(rng: random.Random, first: int) -> list[bytes]:
    """Return the datagrams of some honest messages of one topic, most of them alike."""
    size, cut = rng.choice([2000, 9000, 30_000]), rng.choice([256, 300, 1472])
    found = []
    for seq in range(first, first + rng.randint(1, 4)):
        body = rng.randbytes(size if rng.random() < 0.8 else rng.randint(1, size))
        stamp_nanos = seq % (1 << 30) * 10**9
        whole = Message(1, rng.choice("ab"), "l", stamp_nanos, seq % (1 << 32), body)
        found += [head + bytes(part) for head, part in fragments(whole, cut)]
    return found


def again(rng: random.Random, datagrams: list[bytes]) -> list[bytes]:
    """Return them, mostly, or with whole messages twice, or a part of each before the others."""
    kind = rng.random()
    if kind < 0.1:
        return datagrams + datagrams
    if kind < 0.2:
        first = [mutated(rng, rng.choice(datagrams)) for _ in range(3)]
        return first + datagrams
    if kind < 0.3:
        return rng.sample(datagrams, min(3, len(datagrams))) + datagrams
    return datagrams


def spoilt(rng: random.Random, datagrams: list[bytes], chaos: float) -> list[bytes]:
    """Return them with losses, copies, mutations, strangers, and some out of order."""
    keyed: list[tuple[float, bytes]] = []
    for place, raw in enumerate(datagrams):
        kind = rng.random() / chaos if chaos else 9.0
        if kind < 0.2:
            continue
        if kind < 0.4:
            keyed.append((place, rng.choice([mutated(rng, raw), raw + b"x"])))
        if kind < 0.5:
            keyed.append((place, rng.randbytes(rng.randrange(3000))))
        if kind < 0.6:
            keyed += [(place, other) for other in message(rng)[:3]]
        copies = 2 if 0.6 < kind < 0.8 else 1
        late = rng.random() * 30 if 0.8 < kind < 1 else 0
        keyed += [(place + late, raw)] * copies
    return [raw for _, raw in sorted(keyed, key=lambda row: row[0])]


def run_batch(seed: int) -> Pair:
    """Feed one batch to fresh receivers and return them."""
    rng = random.Random(seed)
    pair = Pair()
    first = 0
    while pair.datagrams < BATCH:
        cut = spoilt(rng, again(rng, stream(rng, first)), rng.choice([0, 0, 0.03, 0.3, 1]))
        first += rng.choice([1, 2, 4, 4, 4, -3 if first > 3 else 0])
        if rng.random() < 0.05:  # far ahead, or farther behind than anything is overtaken
            first = max(0, first + rng.choice([2990, 5000, -150, 1 << 30])) % (1 << 32)
        if rng.random() < 0.05:  # restarted, and silent before
            first = rng.randrange(4)
            pair.feed([], PAUSES_NANOS[-1])
        other = rng.random() < 0.2
        rows = [(raw, int(rng.random() < 0.5 if other else other)) for raw in cut]
        for begin in range(0, len(rows), CHUNK):
            pair.feed(rows[begin : begin + CHUNK], rng.choice(PAUSES_NANOS[: 5 if other else 3]))
    pair.end()
    return pair


def main() -> int:
    """Run batches until there were enough datagrams or the time is over."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.runs")
    parser.add_argument("--datagrams", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=3600.0, help="at most")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    started = time.monotonic()
    seed, fed, in_runs, whole = arguments.seed, 0, 0, 0
    while fed < arguments.datagrams and time.monotonic() - started < arguments.seconds:
        try:
            pair = run_batch(seed)
        except Exception:
            print(f"failed with --seed {seed}", file=sys.stderr)
            raise
        fed, in_runs = fed + pair.datagrams, in_runs + pair.in_runs
        whole += pair.messages
        seed += 1
    how = "many at a time" if IS_BUILT else "one at a time"
    print(
        f"{fed} datagrams in {time.monotonic() - started:.0f} s, received {how}: {in_runs} in"
        f" their places, {whole} messages; equal to what single datagrams give, nothing raised,"
        f" limits held; peak memory {peak_mb():.1f} MB"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
