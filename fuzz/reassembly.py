# SPDX-License-Identifier: Apache-2.0
"""Fuzz the reassembler: refused datagrams change nothing, nothing is raised, limits hold.

`python -m fuzz.reassembly [--datagrams N] [--seconds S] [--seed N]` mixes random bytes, valid
messages, and mutations of these and of the vectors, from several senders. It prints how many there
were and the peak memory of the process. A failure prints the seed that reproduces it.
"""

import argparse
import gc
import random
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from udp_bridge import MSG_TYPES, Header, Limits, Message, Reassembler, Refused, fragments, parse
from udp_bridge.sender.repair import parse_mode
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.capture import datagrams
from udp_bridge.wire.fec import is_available
from udp_bridge.wire.fragments import DatagramSize

BATCH = 20_000
LIMITS = Limits(memory_bytes=1 << 20, senders=8, topics=32)
"""Small enough that every limit is reached all the time."""
SENDERS = 12
"""More than the limit."""
SENDERS_OF_BATCH = (2, SENDERS)
SIZES: list[DatagramSize] = [256, "mtu"]
MODES: list[object] = ["none", "resend", *([{"fec": 0.3}] if is_available() else [])]
PAUSES_NANOS = (0, 0, 0, 1000, 1000, 10**6)
VECTORS = Path(__file__).parents[1] / "tests" / "vectors"
LONGEST = 3000
"""Of random datagrams, in bytes."""


class ReassemblerPair:
    """Two reassemblers; one takes all datagrams, the other one only those that the first accepts.

    Their state must stay equal, which shows that a refused datagram changes nothing.
    """

    def __init__(self) -> None:
        self.counts = Counter[str]()
        """`datagrams`, `refused` and `messages`."""
        self._all = Reassembler(LIMITS)
        self._accepted = Reassembler(LIMITS)
        self._now_nanos = 0

    def feed(self, datagram: bytes, sender: int, pause_nanos: int) -> None:
        """Pass a datagram to both; `AssertionError` when it breaks a rule."""
        self._now_nanos += pause_nanos
        self.counts["datagrams"] += 1
        try:
            header, offset = parse(datagram)
            part = memoryview(datagram)[offset:]
            message = self._all.accept(header, part, sender, self._now_nanos)
        except Refused:
            self.counts["refused"] += 1
            assert 0 <= self._all.memory_bytes <= LIMITS.memory_bytes
            return
        assert 0 <= self._all.memory_bytes <= LIMITS.memory_bytes
        self.counts["messages"] += message is not None
        assert self._accepted.accept(header, part, sender, self._now_nanos) == message

    def compare(self) -> None:
        """Check that both hold and have counted the same."""
        for reassembler in (self._all, self._accepted):
            reassembler.expire(self._now_nanos)
        states = self._state(self._all), self._state(self._accepted)
        assert states[0] == states[1], f"{states[0]} is not {states[1]}"

    def end(self) -> None:
        """Compare; then check that a valid message still passes, and that nothing stays held."""
        self.compare()
        valid = Message(1, "/valid", "", 0, 0, bytes(5000))
        cut = [header + bytes(part) for header, part in fragments(valid)]
        results = [self._all.receive(datagram, "valid", self._now_nanos) for datagram in cut]
        assert [result is not None for result in results] == [True]
        self._all.give_up_all()
        assert self._all.memory_bytes == 0

    def _state(self, reassembler: Reassembler) -> dict[str, Any]:
        counts = reassembler.counters.as_dict()
        del counts["refused"]
        return {
            "totals": counts,
            "memory_bytes": reassembler.memory_bytes,
            "reports": [reassembler.reports(sender, self._now_nanos) for sender in range(SENDERS)],
        }


def message(rng: random.Random) -> list[bytes]:
    """Return the datagrams of a valid message."""
    header = Header(
        msg_type=rng.choice(list(MSG_TYPES)),
        seq_number=rng.choice([0, 1, 2, 255, 256, 2**31, 2**32 - 1, rng.getrandbits(32)]),
        part_number=0,
        parts_max=1,
        time_sec=rng.choice([0, 1, -(2**31), 2**31 - 1]),
        time_nsec=rng.randrange(10**9),
        topic=rng.choice(["", "/a", "/ż", "/" + "x" * rng.randrange(100)]),
        link=rng.choice(["", "l", "y" * rng.randrange(100)]),
    )
    body = rng.randbytes(rng.choice([0, 1, 8, 12, 40, 72, 300, 3000]))
    whole = Message(
        header.msg_type, header.topic, header.link, header.stamp_nanos, header.seq_number, body
    )
    return [head + bytes(part) for head, part in fragments(whole, rng.choice(SIZES))]


def repaired(rng: random.Random) -> list[bytes]:
    """Return the datagrams of two messages with their repair symbols or offers, if any."""
    mode = parse_mode(rng.choice(MODES))
    queue = SendQueue(("", 0), rng.choice(SIZES), repair={} if mode is None else {(1, "/a"): mode})
    cut: list[bytes] = []
    for index in range(2):
        body = rng.randbytes(rng.choice([1, 300, 3000]))
        queue.put(Message(1, "/a", "l", index * 10**9, 0, body))
        while (datagram := queue.take(index)) is not None:
            cut.append(datagram.header + bytes(datagram.part))
    return cut


def recorded() -> list[bytes]:
    """Return the datagrams of all vectors."""
    found = []
    for path in sorted(VECTORS.glob("*.bin")):
        with open(path, "rb") as file:
            found += list(datagrams(file))
    return found


def mutated(rng: random.Random, datagram: bytes) -> bytes:
    """Return a datagram with up to three bytes changed, most of them in the header, or cut."""
    changed = bytearray(datagram)
    bits = rng.getrandbits(16)
    for _ in range(1 + bits % 3 if changed else 0):
        reach = 18 if bits & 64 else 300
        changed[int(rng.random() * min(len(changed), reach))] = rng.getrandbits(8)
    if not bits & 7 << 8:
        del changed[int(rng.random() * (len(changed) + 1)) :]
    return bytes(changed)


def run_batch(seed: int, vectors: list[bytes]) -> Counter[str]:
    """Feed one batch to new reassemblers; return the counts."""
    rng = random.Random(seed)
    pair = ReassemblerPair()
    senders = rng.choice(SENDERS_OF_BATCH)
    while pair.counts["datagrams"] < BATCH:
        pool = [datagram for _ in range(20) for datagram in message(rng)]
        pool += [datagram for _ in range(5) for datagram in repaired(rng)]
        pool += rng.choices(vectors, k=100)
        for _ in range(4 * len(pool)):
            kind = rng.random()
            if kind < 0.05:
                datagram = rng.randbytes(int(LONGEST * rng.random() ** 4))
            else:
                datagram = pool[int(rng.random() * len(pool))]
                if kind < 0.75:
                    datagram = mutated(rng, datagram)
            sender = int(rng.random() * senders)
            pair.feed(datagram, sender, PAUSES_NANOS[rng.getrandbits(8) % len(PAUSES_NANOS)])
        pair.compare()
    pair.end()
    return pair.counts


def run_batches(program: str, run_batch: Callable[[int], Counter[str]]) -> tuple[Counter[str], str]:
    """Run batches until the command line's limits; return the sum of the counts and a summary.

    Parameters
    ----------
    program
        Name of the module.
    run_batch
        Runs one batch with a seed; returns counts, `datagrams` among them.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {program}")
    parser.add_argument("--datagrams", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=3600.0, help="at most")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    started = time.monotonic()
    seed, counts, first_mb = arguments.seed, Counter[str](), 0.0
    while (
        counts["datagrams"] < arguments.datagrams and time.monotonic() - started < arguments.seconds
    ):
        try:
            counts += run_batch(seed)
        except Exception:
            print(f"failed with --seed {seed}", file=sys.stderr)
            raise
        gc.collect()  # receivers hold cycles, and no real one is replaced again and again
        first_mb = first_mb or _peak_mb()
        seed += 1
    return counts, (
        f"{counts['datagrams']} datagrams in {time.monotonic() - started:.0f} s, "
        f"{counts['messages']} messages, peak memory {_peak_mb():.1f} MB, {first_mb:.1f} MB after"
        f" the first {BATCH}"
    )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def main() -> int:
    """Run batches until there were enough datagrams or the time is over."""
    vectors = recorded()
    counts, summary = run_batches("fuzz.reassembly", lambda seed: run_batch(seed, vectors))
    print(f"{summary}; {counts['refused']} refused, without effect; nothing raised, limits held")
    return 0


if __name__ == "__main__":
    sys.exit(main())
